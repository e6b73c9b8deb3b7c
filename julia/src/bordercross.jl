# BorderCross: the paper's two-robot coordination problem (section 3.2), moved by one controller.

"State of [`BorderCross`](@ref): row and column of both robots; all zero once they have crossed."
struct BorderState
    row1::Int
    column1::Int
    row2::Int
    column2::Int
end

const CROSSED = BorderState(0, 0, 0, 0)

# Actions are their own indices: moves of robot 1 (1:4), of robot 2 (5:8), cooperate (9).

"Action of [`BorderCross`](@ref): cross the wall, if both robots stand ready."
const COOPERATE = 9

"""
    BorderCross(; keywords...)

Two robots must meet beside a wall and then cooperate to cross it; all they read is a noisy distance.

| keyword | default | meaning |
|:--|:--|:--|
| `rows`, `columns` | 7, 8 | the grid; the last column is the exit, the one before it the wall |
| `start1` | `(4, 1)` | first cell (row, column) of robot 1, whose cell is always known |
| `start2` | `[(7, 3)]` | cells where robot 2 may start, equally likely; its cell is hidden when there is more than one |
| `crossing_reward` | 500 | team reward (250 for each robot) of cooperating in one cell of the last free column |
| `illegal_move_penalty` | −100 | of a move off the grid or into the wall, which leaves the robot in place |
| `half_efficiency_distance` | 20 | d0 of the sensor: η = 2^(−d/d0) |
| `noise_scale` | 1 | the reading is round(d + abs(N(0, σ))) with σ = (1 − η)·noise_scale |
| `max_reading` | 9 | larger readings are capped to it |
| `discount` | 0.95 | |
| `shaping` | `"none"` | `"paper"`: +1 after a step in which both robots share a cell, +1 after one in which the acting robot (either, for cooperate) stands in the last free column; `"potential"`: Φ(s') − Φ(s), Φ = −(moves still needed to meet there), 0 once they have crossed |

Actions are the integers 1 to 9 (`action_names` spells them), observations the measured distances 0 to `max_reading`.
"""
struct BorderCross{H} <: POMDP{BorderState,Int,Int}   # H robots (0 or 1) have a hidden cell
    rows::Int
    columns::Int
    start1::Tuple{Int,Int}
    start2::Vector{Tuple{Int,Int}}
    crossing_reward::Float64
    illegal_move_penalty::Float64
    half_efficiency_distance::Float64
    noise_scale::Float64
    max_reading::Int
    discount::Float64
    shaping::String
    readings::Matrix{Vector{Float64}}   # [|Δrow| + 1, |Δcolumn| + 1]: probabilities of the readings 0:max_reading
end

function BorderCross(;
    rows::Integer = 7,
    columns::Integer = 8,
    start1 = (4, 1),
    start2 = [(7, 3)],
    crossing_reward::Real = 500.0,
    illegal_move_penalty::Real = -100.0,
    half_efficiency_distance::Real = 20.0,
    noise_scale::Real = 1.0,
    max_reading::Integer = 9,
    discount::Real = 0.95,
    shaping::AbstractString = "none",
)
    columns >= 3 || throw(ArgumentError("columns must be at least 3 (free, wall, exit), not $columns"))
    inside(c) = 1 <= c[1] <= rows && 1 <= c[2] <= columns - 2
    starts = sort!(collect(Tuple{Int,Int}, start2))
    all(inside, [start1; starts]) || throw(ArgumentError("a robot starts off the free cells ($rows × $(columns - 2))"))
    !isempty(starts) && allunique(starts) || throw(ArgumentError("start2 must list different cells, at least one"))
    shaping in BORDER_SHAPINGS || throw(ArgumentError("no shaping '$shaping'; known: $(join(BORDER_SHAPINGS, ", "))"))
    readings = [
        reading_probabilities(hypot(dr, dc), half_efficiency_distance, noise_scale, max_reading)
        for dr in 0:(rows - 1), dc in 0:(columns - 3)
    ]
    return BorderCross{length(starts) > 1 ? 1 : 0}(
        rows, columns, Tuple(start1), starts, crossing_reward, illegal_move_penalty, half_efficiency_distance,
        noise_scale, max_reading, discount, shaping, readings,
    )
end

const BORDER_SHAPINGS = ["none", "paper", "potential"]

"""
Probabilities of the readings 0:limit at the true distance `d`: round(d + X), capped, where X is half-normal
with σ = (1 − 2^(−d/d0))·scale, so P(X < x) = erf(x / (σ√2)).
"""
function reading_probabilities(d, d0, scale, limit)
    σ = (1 - 2.0^(-d / d0)) * scale
    below(x) = x <= 0 ? 0.0 : σ == 0 ? 1.0 : erf(x / (σ * sqrt(2.0)))
    edges = [below(k - 0.5 - d) for k in 0:limit]
    return [(k == limit ? 1.0 : edges[k + 2]) - edges[k + 1] for k in 0:limit]
end

wall_side(m::BorderCross) = m.columns - 2       # the last free column
ncells(m::BorderCross) = m.rows * wall_side(m)
cell_index(m::BorderCross, row, column) = (row - 1) * wall_side(m) + column
cell_at(m::BorderCross, i) = ((i - 1) ÷ wall_side(m) + 1, (i - 1) % wall_side(m) + 1)
hides_robot2(::BorderCross{H}) where {H} = H == 1

"Number of moves still needed until both robots share a cell of the last free column."
moves_needed(m::BorderCross, s::BorderState) =
    abs(s.row1 - s.row2) + (wall_side(m) - s.column1) + (wall_side(m) - s.column2)

"What `shaping = \"potential\"` pays the change of: minus the moves still needed, 0 once the robots have crossed."
potential(m::BorderCross, s::BorderState) = isterminal(m, s) ? 0 : -moves_needed(m, s)

# --- the POMDPs.jl interface ---

"All states of a [`BorderCross`](@ref) in index order, made when asked for."
struct BorderStates{M} <: AbstractVector{BorderState}
    model::M
end
Base.size(v::BorderStates) = (ncells(v.model)^2 + 1,)
function Base.getindex(v::BorderStates, i::Int)
    @boundscheck checkbounds(v, i)
    i == length(v) && return CROSSED
    first, second = divrem(i - 1, ncells(v.model))
    return BorderState(cell_at(v.model, first + 1)..., cell_at(v.model, second + 1)...)
end
Base.in(s::BorderState, v::BorderStates) = s == CROSSED || all(c -> is_free(v.model, c), ((s.row1, s.column1), (s.row2, s.column2)))

POMDPs.states(m::BorderCross) = BorderStates(m)
function POMDPs.stateindex(m::BorderCross, s::BorderState)
    isterminal(m, s) && return ncells(m)^2 + 1
    return (cell_index(m, s.row1, s.column1) - 1) * ncells(m) + cell_index(m, s.row2, s.column2)
end

POMDPs.actions(::BorderCross) = 1:COOPERATE
POMDPs.actions(m::BorderCross, s::BorderState) =
    [a for a in 1:COOPERATE if a == COOPERATE || !isterminal(m, s) && !blocked(m, s, a)]
POMDPs.actionindex(::BorderCross, a::Int) = a
POMDPs.observations(m::BorderCross) = 0:m.max_reading
POMDPs.obsindex(::BorderCross, o::Int) = o + 1
POMDPs.discount(m::BorderCross) = m.discount
POMDPs.isterminal(::BorderCross, s::BorderState) = s.row1 == 0

function POMDPs.initialstate(m::BorderCross)
    n = length(m.start2)
    return SparseCat([BorderState(m.start1..., c...) for c in m.start2], fill(1 / n, n))
end
POMDPs.initialobs(m::BorderCross, s::BorderState) = observation(m, COOPERATE, s)

"Cell that the robot of move `a` would enter, as (row, column)."
target(s::BorderState, a) = a <= 4 ? (s.row1, s.column1) .+ STEPS[a] : (s.row2, s.column2) .+ STEPS[a - 4]

"Whether move `a` leads off the grid or into the wall."
function blocked(m::BorderCross, s::BorderState, a)
    return !is_free(m, target(s, a))
end

"Whether (row, column) is a cell that robots may stand on."
is_free(m::BorderCross, cell) = 1 <= cell[1] <= m.rows && 1 <= cell[2] <= wall_side(m)

together(s::BorderState) = s.row1 == s.row2 && s.column1 == s.column2
can_cross(m::BorderCross, s::BorderState) = together(s) && s.column1 == wall_side(m)

POMDPs.transition(m::BorderCross, s::BorderState, a::Int) = Deterministic(successor(m, s, a))

function successor(m::BorderCross, s::BorderState, a::Int)
    isterminal(m, s) && return s
    a == COOPERATE && return can_cross(m, s) ? CROSSED : s
    blocked(m, s, a) && return s
    cell = target(s, a)
    return a <= 4 ? BorderState(cell..., s.row2, s.column2) : BorderState(s.row1, s.column1, cell...)
end

POMDPs.observation(m::BorderCross, s::BorderState, a::Int, sp::BorderState) = observation(m, a, sp)
POMDPs.observation(m::BorderCross, a::Int, sp::BorderState) =
    SparseCat(0:m.max_reading, m.readings[abs(sp.row1 - sp.row2) + 1, abs(sp.column1 - sp.column2) + 1])

POMDPs.reward(m::BorderCross, s::BorderState, a::Int, sp::BorderState) = reward(m, s, a)
function POMDPs.reward(m::BorderCross, s::BorderState, a::Int)
    isterminal(m, s) && return 0.0
    true_reward = a == COOPERATE ? (can_cross(m, s) ? m.crossing_reward : 0.0) :
                  blocked(m, s, a) ? m.illegal_move_penalty : 0.0
    return true_reward + shaping_bonus(m, s, a, successor(m, s, a))
end

function shaping_bonus(m::BorderCross, s, a, sp)
    if m.shaping == "paper"
        isterminal(m, sp) && return 0.0
        acting = a == COOPERATE ? (sp.column1, sp.column2) : a <= 4 ? (sp.column1,) : (sp.column2,)
        return Float64(together(sp)) + Float64(wall_side(m) in acting)
    elseif m.shaping == "potential"     # no γ: fitness is undiscounted, and with one every step of waiting earned (1 − γ)·|Φ|
        return Float64(potential(m, sp) - potential(m, s))
    end
    return 0.0
end

# --- the harness interface: robot 1's cell is visible; robot 2's too, or it is the one hidden factor ---

nvisible(m::BorderCross) = (hides_robot2(m) ? ncells(m) : ncells(m)^2) + 1
function visible_index(m::BorderCross, s::BorderState)
    isterminal(m, s) && return nvisible(m)
    first = cell_index(m, s.row1, s.column1)
    return hides_robot2(m) ? first : (first - 1) * ncells(m) + cell_index(m, s.row2, s.column2)
end
visible_names(m::BorderCross) = hides_robot2(m) ? ["row1", "column1"] : ["row1", "column1", "row2", "column2"]
function visible_values(m::BorderCross, v)
    s = assemble(m, v, (1,))
    return hides_robot2(m) ? [s.row1, s.column1] : [s.row1, s.column1, s.row2, s.column2]
end

factor_sizes(m::BorderCross{H}) where {H} = ntuple(_ -> ncells(m), Val(H))
factor_names(m::BorderCross) = hides_robot2(m) ? ["robot 2"] : String[]
factor_labels(m::BorderCross, k) = [string(cell_at(m, i)) for i in 1:ncells(m)]
factor_value(m::BorderCross, s::BorderState, k) = isterminal(m, s) ? 1 : cell_index(m, s.row2, s.column2)
relevant_factor(m::BorderCross, v, a) = relevant_factor(m, v)
relevant_factor(m::BorderCross, v) = hides_robot2(m) && v < nvisible(m) ? 1 : 0

function assemble(m::BorderCross, v, values)
    v == nvisible(m) && return CROSSED
    hides_robot2(m) && return BorderState(cell_at(m, v)..., cell_at(m, values[1])...)
    i, j = divrem(v - 1, ncells(m))
    return BorderState(cell_at(m, i + 1)..., cell_at(m, j + 1)...)
end

function belief_features(m::BorderCross)
    hides_robot2(m) || return Tuple{String,Int,Int}[]
    return [("belief($i)", 1, i) for i in 1:ncells(m)]
end
action_names(::BorderCross) = [["$d($r)" for r in 1:2 for d in ("up", "right", "down", "left")]; "cooperate()"]
action_at(::BorderCross, i) = i
observation_at(::BorderCross, i) = i - 1

shapings(::BorderCross) = copy(BORDER_SHAPINGS)
function shaped(m::BorderCross, name::AbstractString)
    return BorderCross(;
        (f => getfield(m, f) for f in fieldnames(BorderCross) if !(f in (:shaping, :readings)))..., shaping = name,
    )
end

function layout(m::BorderCross)
    return Dict{String,Any}(
        "kind" => "bordercross", "columns" => m.columns, "rows" => m.rows, "rows_grow" => "down",
        "wall_column" => m.columns - 1, "exit_column" => m.columns, "start" => [collect(m.start1)],
        "half_efficiency_distance" => m.half_efficiency_distance, "noise_scale" => m.noise_scale,
    )
end
