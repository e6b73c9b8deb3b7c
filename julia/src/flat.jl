# Any finite POMDPs.jl model, seen as one hidden factor: nothing is visible but whether the episode has ended.

"""
A model around another, its field `model`, whose `states`, `actions` and `observations` it holds in index order;
`reads_first` says whether there is an observation before the first step.
"""
abstract type Wrapped{S,A,O} <: POMDP{S,A,O} end

"""
    Flat(m::POMDP)

The harness's view of a model that does not describe its own structure: the whole state is one hidden
factor, and the belief is the ordinary vector over all states. Enumerates the states once.
"""
struct Flat{S,A,O,M<:POMDP{S,A,O}} <: Wrapped{S,A,O}
    model::M
    states::Vector{S}
    actions::Vector{A}
    observations::Vector{O}
    reads_first::Bool
end

# The types named: what a model lists may have a narrower one than it says its states have.
function Flat(m::POMDP{S,A,O}) where {S,A,O}
    for spaces in (states, actions, observations)
        applicable(spaces, m) ||
            throw(ArgumentError("$(nameof(typeof(m))) is no finite model: it has no $(nameof(spaces))(m)"))
    end
    return Flat{S,A,O,typeof(m)}(m, ordered_states(m), ordered_actions(m), ordered_observations(m), reads_first(m))
end

"Whether the model has `initialobs`. A QuickPOMDP has the method always, and throws when it was not given one."
function reads_first(m)
    isempty(methods(initialobs, Tuple{typeof(m),Any})) && return false
    s = rand(Random.Xoshiro(0), initialstate(m))
    applicable(initialobs, m, s) || return false
    try
        initialobs(m, s)
        return true
    catch error
        nameof(typeof(error)) == :MissingQuickArgument || rethrow()
        return false
    end
end

POMDPs.states(f::Wrapped) = f.states
POMDPs.actions(f::Wrapped) = f.actions
POMDPs.actions(f::Wrapped{S}, s::S) where {S} = actions(f.model, s)
POMDPs.observations(f::Wrapped) = f.observations
POMDPs.stateindex(f::Wrapped, s) = stateindex(f.model, s)
POMDPs.actionindex(f::Wrapped, a) = actionindex(f.model, a)
POMDPs.obsindex(f::Wrapped, o) = obsindex(f.model, o)
POMDPs.transition(f::Wrapped, s, a) = transition(f.model, s, a)
POMDPs.observation(f::Wrapped, s, a, sp) = observation(f.model, s, a, sp)
POMDPs.observation(f::Wrapped, a, sp) = observation(f.model, a, sp)
POMDPs.reward(f::Wrapped, s, a) = reward(f.model, s, a)
POMDPs.reward(f::Wrapped, s, a, sp) = reward(f.model, s, a, sp)
POMDPs.initialstate(f::Wrapped) = initialstate(f.model)
POMDPs.discount(f::Wrapped) = discount(f.model)
POMDPs.isterminal(f::Wrapped, s) = isterminal(f.model, s)
POMDPs.isterminal(f::Wrapped, s::TerminalState) = isterminal(f.model, s)  # POMDPTools has one for any model and this state

first_reading(f::Wrapped, s) = f.reads_first ? initialobs(f.model, s) : nothing
action_at(f::Wrapped, i) = f.actions[i]
observation_at(f::Wrapped, i) = f.observations[i]

nvisible(::Flat) = 2
visible_index(f::Flat, s) = isterminal(f, s) ? 2 : 1
visible_names(::Flat) = ["ended"]
visible_values(::Flat, v) = [v - 1]
factor_sizes(f::Flat) = (length(f.states),)
factor_names(::Flat) = ["state"]
factor_labels(f::Flat, k) = state_names(f.model)
factor_value(f::Flat, s, k) = stateindex(f, s)
relevant_factor(::Flat, v, a) = 1
relevant_factor(::Flat, v) = 1
assemble(f::Flat, v, values) = f.states[values[1]]
belief_features(f::Flat) = [("belief($i)", 1, i) for i in eachindex(f.states)]
action_names(f::Flat) = action_names(f.model)
observation_names(f::Flat) = observation_names(f.model)
layout(f::Flat) = layout(f.model)

"""
    harnessed(m::POMDP)

`m` itself when it describes its structure to the harness (`nvisible` and friends), else `Flat(m)`.
"""
harnessed(m::POMDP) = applicable(nvisible, m) ? m : Flat(m)

"""
    first_reading(m, s)

Distribution of the observation made before the first step, or `nothing` for a model without `initialobs`.
"""
first_reading(m::POMDP, s) = applicable(initialobs, m, s) ? initialobs(m, s) : nothing
