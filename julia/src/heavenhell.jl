# Heaven or hell: B. Bonet and H. Geffner, "Solving Large POMDPs using Real Time Dynamic Programming", 1998, who name
# S. Thrun; the rules are those of the file heavenhell.pomdp, which the tests stand beside these.

"State of [`HeavenHell`](@ref): the robot's cell, and whether heaven is on the right."
struct HeavenState
    cell::Int
    right::Bool
end

const HEAVEN_READINGS = (:none, :left, :right)
const HEAVEN_MAP = ["?***?", "  *  ", "  s  ", "  **p"]     # s: the start, p: the priest, ?: heaven and hell

"""
    HeavenHell(; keywords...)

A robot, whose cell is always known, may go and ask a priest which end of a corridor is heaven; the other one is hell.

| keyword | default | meaning |
|:--|:--|:--|
| `reward` | 1 | of a step taken in heaven; minus that of one in hell |
| `accuracy` | 1 | probability that the priest says the truth |
| `discount` | 0.99 | |

Moves are sure; against a wall the robot stays. Whatever the action, a step taken in heaven or hell leads back to the
start, and the sides are drawn anew. The priest is read after every step that ends at his place. Actions are the
integers 1 to 4: up, right, down, left.
"""
struct HeavenHell <: POMDP{HeavenState,Int,Int}
    map::GridMap
    reward::Float64
    accuracy::Float64
    discount::Float64
    start::Int
    priest::Int
    left_end::Int
    right_end::Int
end

function HeavenHell(; reward::Real = 1.0, accuracy::Real = 1.0, discount::Real = 0.99)
    0.5 <= accuracy <= 1 || throw(ArgumentError("accuracy must lie in [0.5, 1], not $accuracy"))
    grid = GridMap(HEAVEN_MAP)
    left_end, right_end = marked(grid, "?")
    return HeavenHell(grid, reward, accuracy, discount, only(marked(grid, "s")), only(marked(grid, "p")), left_end, right_end)
end

# --- the POMDPs.jl interface ---

POMDPs.states(m::HeavenHell) = [HeavenState(cell, right) for cell in 1:ncells(m.map) for right in (false, true)]
POMDPs.stateindex(::HeavenHell, s::HeavenState) = 2 * (s.cell - 1) + s.right + 1
POMDPs.actions(::HeavenHell) = 1:4
POMDPs.actionindex(::HeavenHell, a::Int) = a
POMDPs.observations(::HeavenHell) = 1:length(HEAVEN_READINGS)
POMDPs.obsindex(::HeavenHell, o::Int) = o
POMDPs.discount(m::HeavenHell) = m.discount
POMDPs.initialstate(m::HeavenHell) = SparseCat([HeavenState(m.start, false), HeavenState(m.start, true)], [0.5, 0.5])

at_end(m::HeavenHell, s::HeavenState) = s.cell == m.left_end || s.cell == m.right_end

function POMDPs.transition(m::HeavenHell, s::HeavenState, a::Int)
    at_end(m, s) && return initialstate(m)
    to = neighbour(m.map, s.cell, a)
    return SparseCat([HeavenState(to == 0 ? s.cell : to, s.right)], [1.0])
end

POMDPs.observation(m::HeavenHell, s::HeavenState, a::Int, sp::HeavenState) = observation(m, a, sp)
function POMDPs.observation(m::HeavenHell, a::Int, sp::HeavenState)
    sp.cell == m.priest || return SparseCat(1:3, (1.0, 0.0, 0.0))
    right = sp.right ? m.accuracy : 1 - m.accuracy
    return SparseCat(1:3, (0.0, 1 - right, right))
end

POMDPs.reward(m::HeavenHell, s::HeavenState, a::Int, sp::HeavenState) = reward(m, s, a)
POMDPs.reward(m::HeavenHell, s::HeavenState, a::Int) =
    !at_end(m, s) ? 0.0 : (s.cell == m.right_end) == s.right ? m.reward : -m.reward

# --- the harness interface: the cell is visible, the side of heaven the one hidden factor ---

nvisible(m::HeavenHell) = ncells(m.map)
visible_index(::HeavenHell, s::HeavenState) = s.cell
visible_names(::HeavenHell) = ["x", "y"]
visible_values(m::HeavenHell, v) = collect(m.map.places[v])

factor_sizes(::HeavenHell) = (2,)
factor_names(::HeavenHell) = ["heaven"]
factor_labels(::HeavenHell, k) = ["left", "right"]
factor_value(::HeavenHell, s::HeavenState, k) = s.right + 1
# Only the priest and the ends have to do with the factor; he is read from the cell before his too.
relevant_factor(::HeavenHell, v, a) = 1
relevant_factor(::HeavenHell, v) = 0
assemble(::HeavenHell, v, values) = HeavenState(v, values[1] == 2)

belief_features(::HeavenHell) = [("belief(1)", 1, 2)]
action_names(::HeavenHell) = ["up()", "right()", "down()", "left()"]
observation_names(::HeavenHell) = collect(String.(HEAVEN_READINGS))
action_at(::HeavenHell, i) = i
observation_at(::HeavenHell, i) = i

layout(m::HeavenHell) =
    grid_layout(m.map; signs = [m.left_end => '?', m.right_end => '?', m.priest => 'p'])
