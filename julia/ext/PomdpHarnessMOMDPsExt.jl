"Models of MOMDPs.jl as domains: `x` is the visible part, `y` the one hidden factor."
module PomdpHarnessMOMDPsExt

using MOMDPs
using POMDPs
using POMDPTools
using PomdpHarness: PomdpHarness as H

"The harness's view of a `MOMDP`, whose spaces it enumerates once."
struct Mixed{X,Y,A,O,M<:MOMDP{X,Y,A,O}} <: H.Wrapped{Tuple{X,Y},A,O}
    model::M
    visible::Vector{X}
    hidden::Vector{Y}
    states::Vector{Tuple{X,Y}}
    actions::Vector{A}
    observations::Vector{O}
    reads_first::Bool
end

function Mixed(m::MOMDP{X,Y,A,O}) where {X,Y,A,O}
    spaces = ordered_states_x(m), ordered_states_y(m), ordered_states(m), ordered_actions(m), ordered_observations(m)
    return Mixed{X,Y,A,O,typeof(m)}(m, spaces..., H.reads_first(m))
end

"Whether what is visible says whether the episode has ended; if not, the model is taken as it would be without `x`."
ends_visibly(m) = all(x -> allequal(isterminal(m, (x, y)) for y in states_y(m)), states_x(m))

H.harnessed(m::MOMDP) = ends_visibly(m) ? Mixed(m) : H.Flat(m)
H.belief_updater(m::MOMDP) = H.belief_updater(H.harnessed(m))

H.nvisible(m::Mixed) = length(m.visible)
H.visible_index(m::Mixed, s) = stateindex_x(m.model, s)
H.visible_names(m::Mixed) = numbers(first(m.visible)) === nothing ? ["x"] : names_of(first(m.visible))
H.visible_values(m::Mixed, v) = something(numbers(m.visible[v]), [v])
H.factor_sizes(m::Mixed) = (length(m.hidden),)
H.factor_names(::Mixed) = ["y"]
H.factor_labels(m::Mixed, k) = [string(y) for y in m.hidden]
H.factor_value(m::Mixed, s, k) = stateindex_y(m.model, s)
H.relevant_factor(::Mixed, v, a) = 1
H.relevant_factor(::Mixed, v) = 1
H.assemble(m::Mixed, v, values) = (m.visible[v], m.hidden[values[1]])
H.belief_features(m::Mixed) = [("belief($i)", 1, i) for i in eachindex(m.hidden)]

"The numbers that describe a visible value, where it is a whole number or a vector of them; else `nothing`."
numbers(x::Integer) = [Int(x)]
numbers(x::Union{NTuple{N,Integer} where {N},AbstractVector{<:Integer}}) = collect(Int, x)
numbers(x) = nothing
names_of(::Integer) = ["x"]
names_of(x) = ["x$i" for i in eachindex(x)]

H.with_visible(m::Mixed) = POMDP_of_Discrete_MOMDP(m.model)

"Alpha vectors of SARSOP.jl's policies for such models."
function H.AlphaVectors(m::Mixed, policy::MOMDPAlphaVectorPolicy)
    vectors = Tuple{Int,Int,Vector{Float64}}[]
    for v in 1:H.nvisible(m), (alpha, a) in zip(policy.alphas[v], policy.action_map[v])
        H.is_terminal_value(m, v) || push!(vectors, (v, actionindex(m, a), alpha))
    end
    return H.AlphaVectors(m, vectors)
end

end
