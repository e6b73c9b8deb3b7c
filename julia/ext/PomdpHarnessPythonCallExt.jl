"Policies of the Python package as policies of POMDPs.jl."
module PomdpHarnessPythonCallExt

using POMDPs: POMDP
using PomdpHarness: PomdpHarness, OutsidePolicy
using PythonCall: pyconvert, pyimport

function PomdpHarness.python_policy(m::POMDP, domain, policy; seed::Integer = 0)
    driven = pyimport("harness").Driven(domain, policy; seed)
    act(arguments...) = pyconvert(Vector{Int}, driven.act(arguments...))
    return OutsidePolicy(m, act)
end

end
