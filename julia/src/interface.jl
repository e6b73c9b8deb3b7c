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
([`relevant_factor`](@ref)), so that they stay independent: the belief is a product, and updating it is exact. Any number
of them may then be read unasked, each by itself ([`sensor_factors`](@ref)).
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
    sensor_factors(m)

Tuple of the hidden factors that are read unasked after every step, one entry a *sensor*; `()`, the default, for none.
Given the state, what sensors read is independent of each other and of the step's own observation, so that the factors
stay independent. A model that has some defines [`sensor_sizes`](@ref), [`sensor_names`](@ref), [`sensor_labels`](@ref),
[`sensor_reading`](@ref) and [`own_reading`](@ref) too, and has no `initialobs`.

An observation is a combination of the step's own one and the labels of all sensors: `obsindex` runs through the labels
of the last one fastest. After a step into a terminal state nothing is read, and all labels are the first.
"""
sensor_factors(m) = ()

"""
    sensor_sizes(m)

Tuple of the numbers of labels of the sensors.
"""
sensor_sizes(m) = ()

"""
    sensor_names(m)

One name a sensor, as programs spell it: `3` in `3 == "good"`.
"""
function sensor_names end

"""
    sensor_labels(m, j)

Names of what sensor `j` may read, in index order.
"""
function sensor_labels end

"""
    sensor_reading(m, j, a, sp)

Distribution of the index of the label that sensor `j` reads when action `a` has led to state `sp`. It depends on the
visible part of `sp` and on the value of the sensor's factor only.
"""
function sensor_reading end

"""
    own_reading(m, s, a, sp)

Distribution of the step's own observation, which depends on the relevant factor only: `observation(m, s, a, sp)` of a
model without sensors, else of its index, 1 where it tells nothing.
"""
own_reading(m, s, a, sp) = observation(m, s, a, sp)

"""
    agent_names(m)

Names of the agents of a Dec-POMDP, each of which acts by its own readings alone; none, the default, where one controller
does. A model that has some defines [`agent_actions`](@ref) and [`agent_observations`](@ref) too. The model itself is the
problem of one controller that sees what all of them read: its actions and observations are the combinations of theirs, of
which `actionindex` and `obsindex` run through those of the last agent fastest.
"""
agent_names(m) = String[]

"""
    agent_actions(m, i)

Names of the actions of agent `i`, as its programs spell them, in index order.
"""
function agent_actions end

"""
    agent_observations(m, i)

Names of what agent `i` may observe, in index order.
"""
function agent_observations end

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

has_sensors(m) = !isempty(sensor_factors(m))

"Number of combinations of the sensors' labels (1 without sensors)."
nlabels(m) = prod(sensor_sizes(m); init = 1)

"Number of the steps' own observations."
nown(m) = length(observations(m)) ÷ nlabels(m)

"Index of a value of [`own_reading`](@ref)."
own_index(m, o) = has_sensors(m) ? o : obsindex(m, o)

"The part of an observation that [`own_reading`](@ref) is the distribution of."
own_part(m, o) = has_sensors(m) ? (obsindex(m, o) - 1) ÷ nlabels(m) + 1 : o

"Index of the label that sensor `j` has in the observation with index `i`."
function sensor_label(m, j, i)
    sizes, rest = sensor_sizes(m), i - 1
    for l in length(sizes):-1:(j + 1)
        rest ÷= sizes[l]
    end
    return rest % sizes[j] + 1
end
