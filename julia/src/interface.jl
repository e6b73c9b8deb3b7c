# What the harness asks of a model beyond the POMDPs.jl interface: how a state splits into a part that
# the agent sees and a part that it must estimate, and the names that policies and people use.
#
# Every index is 1-based here. The exported tables (tables.jl) are 0-based, as Python has them.

"""
    nvisible(m)

Number V of values of the visible part of a state (what the agent knows for certain at every step),
terminal values included.
"""
function nvisible end

"""
    visible_index(m, s)

Index in `1:nvisible(m)` of the visible part of state `s`. All states with one index are terminal, or none is.
"""
function visible_index end

"""
    visible_names(m)

Names of the numbers that describe a visible value, for example `["x", "y"]`.
"""
function visible_names end

"""
    visible_values(m, v)

The numbers named by [`visible_names`](@ref) for the visible index `v`, integers.
"""
function visible_values end

"""
    factor_sizes(m)

Tuple of the numbers of values of the hidden factors, `()` when nothing is hidden. Given the visible part,
the factors are independent under the initial distribution, and every step touches at most one of them
([`relevant_factor`](@ref)), so that they stay independent: the belief is a product, and updating it is exact.
"""
function factor_sizes end

"""
    factor_names(m)

One name a hidden factor, for people.
"""
function factor_names end

"""
    factor_labels(m, k)

Names of the values of factor `k`, in index order.
"""
function factor_labels end

"""
    factor_value(m, s, k)

Index of the value that hidden factor `k` has in state `s`.
"""
function factor_value end

"""
    relevant_factor(m, v, a)

The hidden factor on which the outcome (next state, observation, reward) of action `a` at visible value `v`
depends, and the only one which it may change; 0 when there is none.

    relevant_factor(m, v)

The same for the observation made before the first step (`initialobs`).
"""
function relevant_factor end

"""
    assemble(m, v, values)

The state with visible index `v` and hidden factor values `values` (an indexable of K integers).
For a terminal `v` any `values` give the terminal state.
"""
function assemble end

"""
    belief_features(m)

What policies may ask about the belief: a vector of `(name, factor, value)`, the name standing for the
probability that the factor has that value.
"""
function belief_features end

"""
    action_names(m)

Names of the actions as programs spell them, in the order of `actionindex`.
"""
action_names(m::POMDP) = [string(a) for a in ordered_actions(m)]

"""
    observation_names(m)

Names of the observations in the order of `obsindex`.
"""
observation_names(m::POMDP) = [string(o) for o in ordered_observations(m)]

"""
    state_names(m)

Names of the states in the order of `stateindex`, of a model that is one hidden factor to the harness.
"""
state_names(m::POMDP) = [string(s) for s in ordered_states(m)]

"""
    action_at(m, i)

The action with index `i`. Must be fast: the batch simulator calls it once an episode and step.
"""
function action_at end

"""
    observation_at(m, i)

The observation with index `i`.
"""
function observation_at end

"""
    layout(m)

What is needed to draw the domain: a `Dict{String,Any}` of numbers, strings and vectors of them.
"""
layout(m::POMDP) = Dict{String,Any}("kind" => "none")

"""
    shapings(m)

Names of the reward shapings that the model knows; the first, `"none"`, is the true reward.
"""
shapings(m::POMDP) = ["none"]

"""
    shaped(m, name)

The model with the reward shaping `name`. Throws an `ArgumentError` for a name that [`shapings`](@ref) does not list.
"""
function shaped(m::POMDP, name::AbstractString)
    name == "none" || throw(ArgumentError("no shaping '$name' here; known: $(join(shapings(m), ", "))"))
    return m
end

"Number of joint values of the hidden factors (1 when nothing is hidden)."
joint_size(m) = prod(factor_sizes(m); init = 1)

"Factor values of the joint hidden index `h`; the last factor varies fastest."
function joint_values(m, h::Int)
    sizes = factor_sizes(m)
    rest = h - 1
    values = ones(Int, length(sizes))
    for k in length(sizes):-1:1
        rest, r = divrem(rest, sizes[k])
        values[k] = r + 1
    end
    return values
end

"A state with visible index `v` in which factor `k` has the value `x` (any values elsewhere; `k == 0`: any at all)."
function representative(m, v::Int, k::Int, x::Int)
    values = ntuple(j -> j == k ? x : 1, Val(length(factor_sizes(m))))
    return assemble(m, v, values)
end

"Number of rows that belong to (visible value, action): one for each value of the relevant factor."
nrows(m, k::Int) = k == 0 ? 1 : factor_sizes(m)[k]

"Position before the first entry of factor `k` in the concatenated marginals."
function offset(m, k::Int)
    sizes = factor_sizes(m)
    total = 0
    for j in 1:(k - 1)
        total += sizes[j]
    end
    return total
end

"Length of the concatenated marginals of all hidden factors."
nmarginals(m) = sum(factor_sizes(m); init = 0)
