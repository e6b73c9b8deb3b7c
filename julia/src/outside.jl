# The way back: a policy that lives elsewhere, in Python, as a policy of POMDPs.jl in anybody's simulator.

"""
    OutsidePolicy(m, act)

A `Policy` for the model `m` whose decisions a function makes: `act(step, visible, observation, marginals)` is given
0-based indices for E episodes as in [`Simulator`](@ref), `marginals` of size E × Σn, and returns E 0-based action
indices. At step 0 new episodes begin. [`python_policy`](@ref) makes one of a policy of the harness.

Its beliefs are those of `updater(policy)`: the exact belief with the last observation and the number of steps. `action`
takes one of them, or a vector of them, which is one call. One policy object plays one episode, or one vector of episodes,
at a time, as what it remembers of them lies with it.
"""
struct OutsidePolicy{M<:POMDP,F} <: Policy
    model::M
    act::F
    OutsidePolicy(m::POMDP, act) = (h = harnessed(m); new{typeof(h),typeof(act)}(h, act))
end

"""
    python_policy(m, domain, policy; seed = 0)

An [`OutsidePolicy`](@ref) for the model `m` that plays a policy of the Python package: a policy string such as
`"ge-feedback"` or `"program:run/best.txt"`, or a Python object with `reset` and `act`. `domain` is the Python domain of
the model, or its name. Needs PythonCall (`using PythonCall`), with a Python in which the harness is installed.
"""
function python_policy end

"What an [`OutsidePolicy`](@ref) decides on: exact belief, 0-based last observation (−1: none), steps taken."
struct OutsideBelief{B}
    exact::B
    observation::Int
    step::Int
end

"Updater of [`OutsideBelief`](@ref)s."
struct OutsideUpdater{M,U<:Updater} <: Updater
    model::M
    exact::U
end

POMDPs.updater(p::OutsidePolicy) = OutsideUpdater(p.model, belief_updater(original(p.model)))
POMDPs.initialize_belief(up::OutsideUpdater, d) = OutsideBelief(initialize_belief(up.exact, d), -1, 0)
POMDPs.update(up::OutsideUpdater, b::OutsideBelief, a, o) =
    OutsideBelief(update(up.exact, b.exact, a, o), obsindex(up.model, o) - 1, b.step + 1)

POMDPs.action(p::OutsidePolicy, b::OutsideBelief) = only(action(p, [b]))
function POMDPs.action(p::OutsidePolicy, beliefs::AbstractVector{<:OutsideBelief})
    step = first(beliefs).step
    all(b -> b.step == step, beliefs) || throw(ArgumentError("the episodes of a batch must be at the same step"))
    parts = [as_indices(p.model, b.exact) for b in beliefs]
    marginals = stack(last.(parts); dims = 1)
    chosen = p.act(step, Int32.(first.(parts)), Int32[b.observation for b in beliefs], marginals)
    all(>=(0), chosen) || throw(ArgumentError("the policy stops here (action -1), which POMDPs.jl does not know"))
    return [action_at(p.model, i + 1) for i in chosen]
end

"0-based visible index and marginals of an exact belief."
as_indices(m, b::FactoredBelief) = (b.visible - 1, b.marginals)
as_indices(f::Flat, b::DiscreteBelief) = (visible_index(f, f.states[argmax(b.b)]) - 1, b.b)
