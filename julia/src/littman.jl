# TigerGrid, Hallway and Hallway2: M. Littman, A. Cassandra and L. Kaelbling, "Learning policies for partially observable
# environments: Scaling up", ICML 1995; the rules are read off Cassandra's files, which the tests stand beside these.

const SEEN, IMAGINED = 0.9, 0.05    # probability that a wall is seen where there is one, and where there is none
const FACES = ("up", "right", "down", "left")
const LITTMAN_ACTIONS = ["stay()", "forward()", "right()", "around()", "left()"]
const STAY, FORWARD, TURN_RIGHT, TURN_AROUND, TURN_LEFT = 1:5

"""
    LittmanGrid(lines; starts = :anywhere, discount = 0.95)

A robot that knows neither its cell nor where it faces looks for a goal, by noisy readings of the walls around it.

`lines` are a map of text: `*` a cell, `+` a goal, `-` a trap, `o` a landmark, `^` a start, where the robot faces up. Where no
start is marked, it starts anywhere but in a goal, facing anywhere. A step that ends in a goal pays 1, in a trap −1; the step
after a goal leads to a start, whatever the action.

- `stay()` does nothing. `right()` and `left()` turn with probability 0.7; to each of the other three directions the robot
  faces with 0.1. `around()` turns with 0.6, to the sides with 0.15 each, not at all with 0.1.
- `forward()` goes ahead with probability 0.8, to the left or to the right with 0.05 each, facing there, back with 0.05,
  facing back or as before; with the remaining 0.05, and where a wall is in the way, nothing happens.
- In each of the four directions a wall is seen with probability 0.9 where there is one and with 0.05 where there is none.
  The reading names where walls are seen: `F`ront, `R`ight, `B`ack, `L`eft, as in `FRL`; `open` for none. In a goal it is
  `goal`, in landmark i, facing down, `landmark i`.

States are numbered cell by cell, in each by where the robot faces: up, right, down, left.
"""
struct LittmanGrid <: POMDP{Int,Int,Int}
    map::GridMap
    discount::Float64
    readings::Vector{String}
    start::SparseCat{Vector{Int},Vector{Float64}}
    moves::Matrix{SparseCat{Vector{Int},Vector{Float64}}}       # [state, action]
    seen::Vector{SparseCat{Vector{Int},Vector{Float64}}}        # [state]
end

function LittmanGrid(lines; discount::Real = 0.95)
    grid = GridMap(lines)
    landmarks, goals = marked(grid, "o"), marked(grid, "+")
    readings = [[wall_reading(bits) for bits in 0:15]; ["landmark $i" for i in eachindex(landmarks)]; "goal"]
    starts = [facing(cell, 1) for cell in marked(grid, "^")]
    isempty(starts) && (starts = [facing(cell, d) for cell in 1:ncells(grid) if !(cell in goals) for d in 1:4])
    start = SparseCat(starts, fill(1 / length(starts), length(starts)))
    states = 1:(4 * ncells(grid))
    moves = [cell_of(s) in goals ? start : littman_move(grid, s, a) for s in states, a in eachindex(LITTMAN_ACTIONS)]
    return LittmanGrid(grid, discount, readings, start, moves, [littman_reading(grid, landmarks, s) for s in states])
end

facing(cell, d) = 4 * (cell - 1) + d
cell_of(s) = (s - 1) ÷ 4 + 1
direction_of(s) = (s - 1) % 4 + 1
turned(d, quarters) = (d + quarters - 1) % 4 + 1

# What an action leads to, in fortieths: by the quarters that a turn makes; by the quarters from straight ahead in which
# `forward()` goes, and those that it then has turned.
const TURNS = Dict(TURN_RIGHT => (4, 28, 4, 4), TURN_AROUND => (4, 6, 24, 6), TURN_LEFT => (4, 4, 4, 28))
const WAYS = ((0, 0) => 32, (1, 1) => 2, (2, 0) => 1, (2, 2) => 1, (3, 3) => 2)

function littman_move(g::GridMap, s, a)
    cell, d = cell_of(s), direction_of(s)
    shares = a == STAY ? [s => 40] : a == FORWARD ? forward_shares(g, cell, d) :
             [facing(cell, turned(d, quarters)) => share for (quarters, share) in zip(0:3, TURNS[a])]
    sort!(shares)
    return SparseCat(first.(shares), last.(shares) ./ 40)
end

"Where `forward()` leads from a cell, facing `d`; what a wall stops is left to staying, with the rest."
function forward_shares(g::GridMap, cell, d)
    shares = Pair{Int,Int}[]
    for ((way, turn), share) in WAYS
        to = neighbour(g, cell, turned(d, way))
        to == 0 || push!(shares, facing(to, turned(d, turn)) => share)
    end
    return push!(shares, facing(cell, d) => 40 - sum(last, shares; init = 0))
end

"Name of the reading in which walls are seen: of `bits` 8 is front, 4 right, 2 back, 1 left."
function wall_reading(bits)
    name = join(word for (bit, word) in ((8, "F"), (4, "R"), (2, "B"), (1, "L")) if bits & bit > 0)
    return isempty(name) ? "open" : name
end

function littman_reading(g::GridMap, landmarks, s)
    cell, d = cell_of(s), direction_of(s)
    g.marks[cell] == '+' && return SparseCat([17 + length(landmarks)], [1.0])
    i = findfirst(==(cell), landmarks)
    i !== nothing && d == 3 && return SparseCat([16 + i], [1.0])
    walls = [neighbour(g, cell, turned(d, q)) == 0 for q in 0:3]
    probability(bits) = prod(
        (seen = bits >> (3 - q) & 1; p = walls[q + 1] ? SEEN : IMAGINED; seen == 1 ? p : 1 - p) for q in 0:3
    )
    return SparseCat(collect(1:16), [probability(bits) for bits in 0:15])
end

# --- the POMDPs.jl interface; to the harness the state is one hidden factor (`Flat`) ---

POMDPs.states(m::LittmanGrid) = 1:(4 * ncells(m.map))
POMDPs.stateindex(::LittmanGrid, s::Int) = s
POMDPs.actions(::LittmanGrid) = eachindex(LITTMAN_ACTIONS)
POMDPs.actionindex(::LittmanGrid, a::Int) = a
POMDPs.observations(m::LittmanGrid) = eachindex(m.readings)
POMDPs.obsindex(::LittmanGrid, o::Int) = o
POMDPs.discount(m::LittmanGrid) = m.discount
POMDPs.isterminal(::LittmanGrid, s::Int) = false
POMDPs.initialstate(m::LittmanGrid) = m.start
POMDPs.transition(m::LittmanGrid, s::Int, a::Int) = m.moves[s, a]
POMDPs.observation(m::LittmanGrid, s::Int, a::Int, sp::Int) = m.seen[sp]
POMDPs.observation(m::LittmanGrid, a::Int, sp::Int) = m.seen[sp]
function POMDPs.reward(m::LittmanGrid, s::Int, a::Int, sp::Int)
    mark = m.map.marks[cell_of(sp)]
    return mark == '+' ? 1.0 : mark == '-' ? -1.0 : 0.0
end
POMDPs.reward(m::LittmanGrid, s::Int, a::Int) =
    sum(p * reward(m, s, a, sp) for (sp, p) in weighted_iterator(transition(m, s, a)))

action_names(::LittmanGrid) = LITTMAN_ACTIONS
observation_names(m::LittmanGrid) = m.readings
state_names(m::LittmanGrid) = ["$(m.map.places[cell_of(s)]) $(FACES[direction_of(s)])" for s in states(m)]
layout(m::LittmanGrid) = grid_layout(
    m.map; signs = [cell => m.map.marks[cell] for cell in marked(m.map, "+-o")], hidden = [cell_of(s) for s in states(m)],
)
