# Tag: J. Pineau, G. Gordon and S. Thrun, "Point-based Value Iteration", IJCAI 2003; the rules are those of APPL's
# TagAvoid.pomdpx (AdaCompNUS/sarsop), which the tests stand beside these.

"State of [`Tag`](@ref): the cells of the robot and of the opponent; both zero once it is tagged."
struct TagState
    robot::Int
    opponent::Int
end

const TAGGED = TagState(0, 0)
const TAG = 5       # the actions 1:4 are the moves up, right, down, left
const TAG_READINGS = (:none, :here)
const TAG_MAP = ["     ***  ", "     ***  ", "     ***  ", "**********", "**********"]

"""
    Tag(; keywords...)

A robot, whose cell is always known, looks for an opponent that moves away from it, and tags it in a shared cell.

| keyword | default | meaning |
|:--|:--|:--|
| `map` | 29 cells | lines of text, the first at the top |
| `step_reward` | −1 | of every move, one against a wall too |
| `tag_reward` | 10 | of tagging in the opponent's cell, which ends the episode |
| `miss_reward` | −10 | of tagging elsewhere |
| `discount` | 0.95 | |

Robot and opponent start anywhere, independently. When the robot moves, so does the opponent, by where both were before:
with 0.4 away from the robot along the row and with 0.4 along the column (0.2 each way where they share it), else it
stays; so it does where a wall is in the way. Nobody moves when a tag misses. The robot reads `:here` in the opponent's
cell. Actions are the integers 1 to 5: up, right, down, left, tag.
"""
struct Tag <: POMDP{TagState,Int,Int}
    map::GridMap
    step_reward::Float64
    tag_reward::Float64
    miss_reward::Float64
    discount::Float64
    fleeing::Matrix{Vector{Pair{Int,Float64}}}      # [robot, opponent]: the opponent's next cells in order, by probability
end

function Tag(;
    map = TAG_MAP, step_reward::Real = -1.0, tag_reward::Real = 10.0, miss_reward::Real = -10.0, discount::Real = 0.95,
)
    grid = GridMap(map)
    cells = 1:ncells(grid)
    return Tag(grid, step_reward, tag_reward, miss_reward, discount, [flight(grid, r, o) for r in cells, o in cells])
end

"Next cells of an opponent in `cell` with a robot in `robot`; probabilities are fifths, added up before they are divided."
function flight(g::GridMap, robot, cell)
    fifths = Dict(cell => 1)
    Δx, Δy = g.places[cell] .- g.places[robot]
    for (d, away) in ((1, -Δy), (2, Δx), (3, Δy), (4, -Δx))
        away < 0 && continue
        to = neighbour(g, cell, d)
        to = to == 0 ? cell : to
        fifths[to] = get(fifths, to, 0) + (away > 0 ? 2 : 1)
    end
    return [to => share / 5 for (to, share) in sort!(collect(fifths))]
end

# --- the POMDPs.jl interface ---

POMDPs.states(m::Tag) = [[TagState(r, o) for r in 1:ncells(m.map) for o in 1:ncells(m.map)]; TAGGED]
POMDPs.stateindex(m::Tag, s::TagState) =
    s == TAGGED ? ncells(m.map)^2 + 1 : (s.robot - 1) * ncells(m.map) + s.opponent
POMDPs.actions(::Tag) = 1:TAG
POMDPs.actionindex(::Tag, a::Int) = a
POMDPs.observations(::Tag) = 1:length(TAG_READINGS)
POMDPs.obsindex(::Tag, o::Int) = o
POMDPs.discount(m::Tag) = m.discount
POMDPs.isterminal(::Tag, s::TagState) = s == TAGGED
POMDPs.initialstate(m::Tag) =
    SparseCat(states(m)[1:(end - 1)], fill(1 / ncells(m.map)^2, ncells(m.map)^2))

tags(s::TagState, a) = a == TAG && s.robot == s.opponent

function POMDPs.transition(m::Tag, s::TagState, a::Int)
    (s == TAGGED || a == TAG) && return SparseCat([tags(s, a) ? TAGGED : s], [1.0])
    to = neighbour(m.map, s.robot, a)
    robot = to == 0 ? s.robot : to
    next = m.fleeing[s.robot, s.opponent]
    return SparseCat([TagState(robot, cell) for (cell, _) in next], last.(next))
end

POMDPs.observation(m::Tag, s::TagState, a::Int, sp::TagState) = observation(m, a, sp)
POMDPs.observation(::Tag, a::Int, sp::TagState) =
    Deterministic(sp != TAGGED && sp.robot == sp.opponent ? 2 : 1)

POMDPs.reward(m::Tag, s::TagState, a::Int, sp::TagState) = reward(m, s, a)
function POMDPs.reward(m::Tag, s::TagState, a::Int)
    s == TAGGED && return 0.0
    return a != TAG ? m.step_reward : tags(s, a) ? m.tag_reward : m.miss_reward
end

# --- the harness interface: the robot's cell is visible, the opponent's the one hidden factor ---

nvisible(m::Tag) = ncells(m.map) + 1
visible_index(m::Tag, s::TagState) = s == TAGGED ? nvisible(m) : s.robot
visible_names(::Tag) = ["x", "y"]
visible_values(m::Tag, v) = v == nvisible(m) ? [0, 0] : collect(m.map.places[v])

factor_sizes(m::Tag) = (ncells(m.map),)
factor_names(::Tag) = ["opponent"]
factor_labels(m::Tag, k) = [string(place) for place in m.map.places]
factor_value(::Tag, s::TagState, k) = max(s.opponent, 1)
relevant_factor(m::Tag, v, a) = v == nvisible(m) ? 0 : 1
relevant_factor(::Tag, v) = 0
assemble(m::Tag, v, values) = v == nvisible(m) ? TAGGED : TagState(v, values[1])

belief_features(m::Tag) = [("belief($i)", 1, i) for i in 1:ncells(m.map)]
action_names(::Tag) = ["up()", "right()", "down()", "left()", "tag()"]
observation_names(::Tag) = collect(String.(TAG_READINGS))
action_at(::Tag, i) = i
observation_at(::Tag, i) = i

layout(m::Tag) = grid_layout(m.map; hidden = 1:ncells(m.map))
