# BorderCross as a Dec-POMDP: both robots act at once, each by its own reading of the distance.

"""
    DecBorderCross(; keywords...)

[`BorderCross`](@ref) with a controller for each robot. In every step each of them moves or cooperates, by itself; they cross
when both cooperate in one cell of the last free column. A robot that cooperates anywhere else, or alone, waits. Every move
that is blocked costs `illegal_move_penalty` and leaves its robot in place. Each robot reads the distance with noise of its
own.

Keywords are those of [`BorderCross`](@ref); of its shapings there are `"none"` and `"potential"`. Joint actions are
`1:25`, robot 2's own action running fastest (up, right, down, left, cooperate); joint observations the indices of both
readings, robot 2's running fastest. To one controller of both that sees both readings it is a POMDP (the MPOMDP of
D. Pynadath and M. Tambe, JAIR 16, 2002), which is what a `POMDP` of it means; [`agent_names`](@ref) says who acts.
"""
struct DecBorderCross{H} <: POMDP{BorderState,Int,Int}
    base::BorderCross{H}
    readings::Matrix{Vector{Float64}}   # as the base's: probabilities of joint observations
end

function DecBorderCross(; keywords...)
    base = BorderCross(; keywords...)
    base.shaping in DEC_BORDER_SHAPINGS ||
        throw(ArgumentError("no shaping '$(base.shaping)'; known: $(join(DEC_BORDER_SHAPINGS, ", "))"))
    return DecBorderCross(base, map(p -> kron(p, p), base.readings))
end

const DEC_BORDER_SHAPINGS = ["none", "potential"]
const ROBOT_ACTIONS = ["up()", "right()", "down()", "left()", "cooperate()"]
const BOTH_COOPERATE = length(ROBOT_ACTIONS)^2

"The base's action that robot `r` takes its part of joint action `a` by; `COOPERATE`, alone, where that is none of the moves."
function part_of(a, r)
    n = length(ROBOT_ACTIONS)
    own = (r == 1 ? (a - 1) ÷ n : (a - 1) % n) + 1
    return own == n ? COOPERATE : own + 4(r - 1)
end

# --- the POMDPs.jl interface ---

POMDPs.states(m::DecBorderCross) = states(m.base)
POMDPs.stateindex(m::DecBorderCross, s::BorderState) = stateindex(m.base, s)
POMDPs.actions(::DecBorderCross) = 1:BOTH_COOPERATE
POMDPs.actions(m::DecBorderCross, s::BorderState) =
    [a for a in 1:BOTH_COOPERATE if a == BOTH_COOPERATE || !isterminal(m, s) && nblocked(m, s, a) == 0]
POMDPs.actionindex(::DecBorderCross, a::Int) = a
POMDPs.observations(m::DecBorderCross) = 1:(m.base.max_reading + 1)^2
POMDPs.obsindex(::DecBorderCross, o::Int) = o
POMDPs.discount(m::DecBorderCross) = discount(m.base)
POMDPs.isterminal(m::DecBorderCross, s::BorderState) = isterminal(m.base, s)
POMDPs.initialstate(m::DecBorderCross) = initialstate(m.base)
POMDPs.initialobs(m::DecBorderCross, s::BorderState) = observation(m, BOTH_COOPERATE, s)

"How many robots' parts of joint action `a` are moves that are blocked."
nblocked(m::DecBorderCross, s::BorderState, a) =
    count(r -> (move = part_of(a, r)) != COOPERATE && blocked(m.base, s, move), 1:2)

POMDPs.transition(m::DecBorderCross, s::BorderState, a::Int) = Deterministic(successor(m, s, a))

function successor(m::DecBorderCross, s::BorderState, a::Int)
    a == BOTH_COOPERATE && return successor(m.base, s, COOPERATE)
    for r in 1:2        # in either order: robots do not stand in each other's way
        move = part_of(a, r)
        move == COOPERATE || (s = successor(m.base, s, move))
    end
    return s
end

POMDPs.observation(m::DecBorderCross, s::BorderState, a::Int, sp::BorderState) = observation(m, a, sp)
POMDPs.observation(m::DecBorderCross, a::Int, sp::BorderState) =
    SparseCat(observations(m), m.readings[abs(sp.row1 - sp.row2) + 1, abs(sp.column1 - sp.column2) + 1])

POMDPs.reward(m::DecBorderCross, s::BorderState, a::Int, sp::BorderState) = reward(m, s, a)
function POMDPs.reward(m::DecBorderCross, s::BorderState, a::Int)
    isterminal(m, s) && return 0.0
    true_reward = a == BOTH_COOPERATE && can_cross(m.base, s) ? m.base.crossing_reward :
                  m.base.illegal_move_penalty * nblocked(m, s, a)
    return true_reward + shaping_bonus(m.base, s, a, successor(m, s, a))
end

# --- the harness interface: as the base's, with two agents ---

nvisible(m::DecBorderCross) = nvisible(m.base)
visible_index(m::DecBorderCross, s::BorderState) = visible_index(m.base, s)
visible_names(m::DecBorderCross) = visible_names(m.base)
visible_values(m::DecBorderCross, v) = visible_values(m.base, v)

factor_sizes(m::DecBorderCross) = factor_sizes(m.base)
factor_names(m::DecBorderCross) = factor_names(m.base)
factor_labels(m::DecBorderCross, k) = factor_labels(m.base, k)
factor_value(m::DecBorderCross, s::BorderState, k) = factor_value(m.base, s, k)
relevant_factor(m::DecBorderCross, v, a) = relevant_factor(m.base, v)
relevant_factor(m::DecBorderCross, v) = relevant_factor(m.base, v)
assemble(m::DecBorderCross, v, values) = assemble(m.base, v, values)
belief_features(m::DecBorderCross) = belief_features(m.base)

agent_names(::DecBorderCross) = ["robot 1", "robot 2"]
agent_actions(::DecBorderCross, i) = copy(ROBOT_ACTIONS)
agent_observations(m::DecBorderCross, i) = string.(0:m.base.max_reading)

action_names(::DecBorderCross) =
    ["$(chop(first; tail = 2))-$second" for first in ROBOT_ACTIONS for second in ROBOT_ACTIONS]
observation_names(m::DecBorderCross) = ["$i $j" for i in 0:m.base.max_reading for j in 0:m.base.max_reading]
action_at(::DecBorderCross, i) = i
observation_at(::DecBorderCross, i) = i

shapings(::DecBorderCross) = copy(DEC_BORDER_SHAPINGS)
function shaped(m::DecBorderCross, name::AbstractString)
    name in DEC_BORDER_SHAPINGS || throw(ArgumentError("no shaping '$name' here; known: $(join(DEC_BORDER_SHAPINGS, ", "))"))
    return DecBorderCross(shaped(m.base, name), m.readings)
end

layout(m::DecBorderCross) = layout(m.base)
