# RockSample(n, k): T. Smith and R. Simmons, "Heuristic Search Value Iteration for POMDPs", UAI 2004.

"State of [`RockSample`](@ref): the robot's cell (column `x`, row `y`; (0, 0) once it has left) and which rocks are good."
struct RockState{K}
    x::Int
    y::Int
    good::SVector{K,Bool}
end

# Actions are their own indices; the names below are how the code speaks of them.
"Action of [`RockSample`](@ref): north."
const UP = 1
"Action of [`RockSample`](@ref): east; from the last column it leaves."
const RIGHT = 2
"Action of [`RockSample`](@ref): south."
const DOWN = 3
"Action of [`RockSample`](@ref): west."
const LEFT = 4
"Action of [`RockSample`](@ref): take a sample of the rock in the robot's cell."
const SAMPLE = 5
const MOVES = ((0, 1), (1, 0), (0, -1), (-1, 0))

"Action that checks rock `i` of a [`RockSample`](@ref)."
check(i::Integer) = SAMPLE + Int(i)

const ROCK_READINGS = (:none, :good, :bad)

"""
    RockSample(rocks; keywords...)

A robot on a grid looks for good rocks with a noisy long-range sensor and leaves in the east.

`rocks` are the `(x, y)` cells of the K rocks, `x` growing eastward and `y` northward from 1. Keywords:

| keyword | default | meaning |
|:--|:--|:--|
| `columns`, `rows` | 7, `columns` | size of the grid that the robot moves on; the exit lies east of the last column |
| `start`, `starts` | `(1, cld(rows, 2))`, `[start]` | the robot's first cell; several, equally likely |
| `good_probability` | 0.5 | of each rock, independently |
| `good_reward`, `bad_reward` | 10, −10 | of sampling a good or a bad rock |
| `exit_reward` | 10 | of moving right from the last column, which ends the episode |
| `illegal_move_penalty` | −100 | of any other move off the grid, which leaves the robot where it is |
| `empty_sample_penalty` | 0 | of sampling where no rock is |
| `illegal_ends` | `false` | whether what costs one of these two penalties ends the episode |
| `half_efficiency_distance`, `best_accuracy` | 20, 1 | d0 and b of the sensor: a reading is right with probability 0.5 + (b − 0.5)·2^(−d/d0) |
| `discount` | 0.95 | |

Actions are the integers `UP, RIGHT, DOWN, LEFT, SAMPLE, check(1) … check(K)` (1 to 5+K), observations the
symbols `:none :good :bad`. A sampled rock is bad afterwards. `actions(m, s)` lists neither moves off the grid nor samples that
cost `empty_sample_penalty`.

    RockSample(n, k; rng, keywords...)

`k` rocks in cells drawn with `rng` on an n × n grid.
"""
struct RockSample{K} <: POMDP{RockState{K},Int,Symbol}
    columns::Int
    rows::Int
    rocks::SVector{K,Tuple{Int,Int}}
    starts::Vector{Tuple{Int,Int}}
    good_probability::Float64
    good_reward::Float64
    bad_reward::Float64
    exit_reward::Float64
    illegal_move_penalty::Float64
    empty_sample_penalty::Float64
    illegal_ends::Bool
    half_efficiency_distance::Float64
    best_accuracy::Float64
    discount::Float64
    accuracy::Matrix{Float64}       # [cell, rock]: probability that a reading is right
    rock_at::Vector{Int}            # [cell]: the rock there, 0 for none
    legal::Vector{Vector{Int}}      # [cell]: what `actions(m, s)` lists
end

function RockSample(
    rocks::AbstractVector;
    columns::Integer = 7,
    rows::Integer = columns,
    start = (1, cld(rows, 2)),
    starts = [start],
    good_probability::Real = 0.5,
    good_reward::Real = 10.0,
    bad_reward::Real = -10.0,
    exit_reward::Real = 10.0,
    illegal_move_penalty::Real = -100.0,
    empty_sample_penalty::Real = 0.0,
    illegal_ends::Bool = false,
    half_efficiency_distance::Real = 20.0,
    best_accuracy::Real = 1.0,
    discount::Real = 0.95,
)
    inside(c) = 1 <= c[1] <= columns && 1 <= c[2] <= rows
    all(inside, rocks) || throw(ArgumentError("a rock lies off the $columns × $rows grid: $rocks"))
    allunique(rocks) || throw(ArgumentError("two rocks share a cell: $rocks"))
    starts = sort!(collect(Tuple{Int,Int}, starts); by = reverse)      # in the order of the cells
    all(inside, starts) || throw(ArgumentError("a start lies off the $columns × $rows grid: $starts"))
    !isempty(starts) && allunique(starts) || throw(ArgumentError("starts must list different cells, at least one"))
    0 <= good_probability <= 1 || throw(ArgumentError("good_probability must lie in [0, 1], not $good_probability"))
    half_efficiency_distance > 0 || throw(ArgumentError("half_efficiency_distance must be positive"))
    0.5 <= best_accuracy <= 1 || throw(ArgumentError("best_accuracy must lie in [0.5, 1], not $best_accuracy"))
    K = length(rocks)
    cells = [(x, y) for y in 1:rows for x in 1:columns]
    accuracy = [sensor_accuracy(c, r, half_efficiency_distance, best_accuracy) for c in cells, r in rocks]
    rock_at = [something(findfirst(==(c), rocks), 0) for c in cells]
    forbidden(c, rock, a) =
        leaves_grid(c, a, rows) || (a == SAMPLE && rock == 0 && (empty_sample_penalty != 0 || illegal_ends))
    legal = [[a for a in 1:(SAMPLE + K) if !forbidden(c, rock, a)] for (c, rock) in zip(cells, rock_at)]
    return RockSample{K}(
        columns, rows, SVector{K,Tuple{Int,Int}}(Tuple.(rocks)), starts, good_probability, good_reward,
        bad_reward, exit_reward, illegal_move_penalty, empty_sample_penalty, illegal_ends, half_efficiency_distance,
        best_accuracy, discount, accuracy, rock_at, legal,
    )
end

function RockSample(n::Integer, k::Integer; rng::AbstractRNG, keywords...)
    k <= n * n || throw(ArgumentError("$k rocks do not fit on a $n × $n grid"))
    cells = randperm(rng, n * n)[1:k]
    return RockSample([((c - 1) % n + 1, (c - 1) ÷ n + 1) for c in cells]; columns = n, keywords...)
end

"Probability that the sensor reads the rock at `rock` rightly from `cell` (paper, eq. 3, where `best` is 1; d Euclidean)."
sensor_accuracy(cell, rock, d0, best) = 0.5 + (best - 0.5) * 2.0^(-hypot(cell[1] - rock[1], cell[2] - rock[2]) / d0)

"Whether `a` is a move off the grid that is not the exit."
function leaves_grid(cell, a, rows)
    a <= LEFT || return false
    x, y = cell .+ MOVES[a]
    return x < 1 || y < 1 || y > rows
end

cell_index(m::RockSample, x, y) = (y - 1) * m.columns + x
ncells(m::RockSample) = m.columns * m.rows
out(m::RockSample{K}) where {K} = RockState{K}(0, 0, zero(SVector{K,Bool}))
nactions(::RockSample{K}) where {K} = SAMPLE + K

# --- the POMDPs.jl interface ---

"All states of a [`RockSample`](@ref) in index order, made when asked for."
struct RockStates{K} <: AbstractVector{RockState{K}}
    model::RockSample{K}
end
Base.size(v::RockStates{K}) where {K} = (ncells(v.model) * 2^K + 1,)
function Base.getindex(v::RockStates{K}, i::Int) where {K}
    @boundscheck checkbounds(v, i)
    i == length(v) && return out(v.model)
    cell, bits = divrem(i - 1, 2^K)
    y, x = divrem(cell, v.model.columns)
    return RockState{K}(x + 1, y + 1, SVector{K,Bool}(ntuple(k -> isodd(bits >> (K - k)), Val(K))))
end
Base.in(s::RockState{K}, v::RockStates{K}) where {K} =
    s == out(v.model) || (1 <= s.x <= v.model.columns && 1 <= s.y <= v.model.rows)

rock_bits(good::SVector{K,Bool}) where {K} = foldl((bits, g) -> 2bits + g, good; init = 0)

POMDPs.states(m::RockSample) = RockStates(m)
function POMDPs.stateindex(m::RockSample{K}, s::RockState{K}) where {K}
    isterminal(m, s) && return ncells(m) * 2^K + 1
    return (cell_index(m, s.x, s.y) - 1) * 2^K + rock_bits(s.good) + 1
end

POMDPs.actions(m::RockSample) = 1:nactions(m)
POMDPs.actions(m::RockSample{K}, s::RockState{K}) where {K} =
    isterminal(m, s) ? m.legal[1][1:0] : m.legal[cell_index(m, s.x, s.y)]
POMDPs.actionindex(m::RockSample, a::Int) = a

POMDPs.observations(::RockSample) = ROCK_READINGS
POMDPs.obsindex(::RockSample, o::Symbol) = o === :none ? 1 : o === :good ? 2 : 3

POMDPs.discount(m::RockSample) = m.discount
POMDPs.isterminal(::RockSample, s::RockState) = s.x == 0

"Initial distribution of a [`RockSample`](@ref): each start as likely, and each rock good with the same probability."
struct RockStart{K}
    model::RockSample{K}
end
function POMDPs.support(d::RockStart{K}) where {K}
    firsts = [(cell_index(d.model, c...) - 1) * 2^K for c in d.model.starts]
    return view(RockStates(d.model), reduce(vcat, [(first + 1):(first + 2^K) for first in firsts]))
end
function POMDPs.pdf(d::RockStart{K}, s::RockState{K}) where {K}
    (s.x, s.y) in d.model.starts || return 0.0
    p = d.model.good_probability
    good = count(s.good)
    return p^good * (1 - p)^(K - good) / length(d.model.starts)
end
function Base.rand(rng::AbstractRNG, d::Random.SamplerTrivial{RockStart{K}}) where {K}
    m = d[].model
    start = length(m.starts) == 1 ? only(m.starts) : rand(rng, m.starts)
    return RockState{K}(start..., SVector{K,Bool}(ntuple(_ -> rand(rng) < m.good_probability, Val(K))))
end
Base.eltype(::Type{RockStart{K}}) where {K} = RockState{K}

POMDPs.initialstate(m::RockSample) = RockStart(m)
POMDPs.initialobs(m::RockSample, s::RockState) = Deterministic(:none)

function POMDPs.transition(m::RockSample{K}, s::RockState{K}, a::Int) where {K}
    return Deterministic(successor(m, s, a))
end

function successor(m::RockSample{K}, s::RockState{K}, a::Int) where {K}
    isterminal(m, s) && return s
    if a <= LEFT
        leaves_grid((s.x, s.y), a, m.rows) && return m.illegal_ends ? out(m) : s
        x, y = (s.x, s.y) .+ MOVES[a]
        return x > m.columns ? out(m) : RockState{K}(x, y, s.good)
    elseif a == SAMPLE
        rock = m.rock_at[cell_index(m, s.x, s.y)]
        rock == 0 && return m.illegal_ends ? out(m) : s
        return RockState{K}(s.x, s.y, setindex(s.good, false, rock))
    end
    return s
end

POMDPs.observation(m::RockSample, s::RockState, a::Int, sp::RockState) = observation(m, a, sp)
function POMDPs.observation(m::RockSample{K}, a::Int, sp::RockState{K}) where {K}
    (a <= SAMPLE || isterminal(m, sp)) && return SparseCat(ROCK_READINGS, (1.0, 0.0, 0.0))
    rock = a - SAMPLE
    right = m.accuracy[cell_index(m, sp.x, sp.y), rock]
    return SparseCat(ROCK_READINGS, sp.good[rock] ? (0.0, right, 1 - right) : (0.0, 1 - right, right))
end

POMDPs.reward(m::RockSample, s::RockState, a::Int, sp::RockState) = reward(m, s, a)
function POMDPs.reward(m::RockSample{K}, s::RockState{K}, a::Int) where {K}
    isterminal(m, s) && return 0.0
    if a <= LEFT
        leaves_grid((s.x, s.y), a, m.rows) && return m.illegal_move_penalty
        return a == RIGHT && s.x == m.columns ? m.exit_reward : 0.0
    elseif a == SAMPLE
        rock = m.rock_at[cell_index(m, s.x, s.y)]
        rock == 0 && return m.empty_sample_penalty
        return s.good[rock] ? m.good_reward : m.bad_reward
    end
    return 0.0
end

# --- the harness interface: the cell is visible, every rock a hidden factor (1 bad, 2 good) ---

nvisible(m::RockSample) = ncells(m) + 1
visible_index(m::RockSample, s::RockState) = isterminal(m, s) ? ncells(m) + 1 : cell_index(m, s.x, s.y)
visible_names(::RockSample) = ["x", "y"]
visible_values(m::RockSample, v) = v > ncells(m) ? [0, 0] : [(v - 1) % m.columns + 1, (v - 1) ÷ m.columns + 1]

factor_sizes(::RockSample{K}) where {K} = ntuple(_ -> 2, Val(K))
factor_names(::RockSample{K}) where {K} = ["rock $i" for i in 1:K]
factor_labels(::RockSample, k) = ["bad", "good"]
factor_value(::RockSample, s::RockState, k) = s.good[k] ? 2 : 1

relevant_factor(m::RockSample, v) = 0
function relevant_factor(m::RockSample, v, a::Int)
    (a <= LEFT || v > ncells(m)) && return 0
    return a == SAMPLE ? m.rock_at[v] : a - SAMPLE
end

function assemble(m::RockSample{K}, v, values) where {K}
    v > ncells(m) && return out(m)
    y, x = divrem(v - 1, m.columns)
    return RockState{K}(x + 1, y + 1, SVector{K,Bool}(ntuple(k -> values[k] == 2, Val(K))))
end

belief_features(::RockSample{K}) where {K} = [("belief($i)", i, 2) for i in 1:K]
action_names(::RockSample{K}) where {K} =
    ["up()", "right()", "down()", "left()", "sample()", ("check($i)" for i in 1:K)...]
observation_names(::RockSample) = collect(String.(ROCK_READINGS))
action_at(::RockSample, i) = i
observation_at(::RockSample, i) = ROCK_READINGS[i]

function layout(m::RockSample)
    return Dict{String,Any}(
        "kind" => "rocksample", "columns" => m.columns, "rows" => m.rows, "rows_grow" => "up",
        "exit_column" => m.columns + 1, "start" => collect(first(m.starts)),
        "rocks" => [collect(r) for r in m.rocks],
        "half_efficiency_distance" => m.half_efficiency_distance, "best_accuracy" => m.best_accuracy,
    )
end
