# FieldVisionRockSample: S. Ross, J. Pineau, S. Paquet and B. Chaib-draa, "Online planning algorithms for POMDPs", JAIR 32, 2008.

"""
    FieldVision(rocks; keywords...)

RockSample without checks: every step reads all rocks, each by a noisy reading of its own, from the cell that it has led to.

`rocks` and keywords are those of [`RockSample`](@ref), all else too; but the sensor reaches less far, with
`half_efficiency_distance` (n − 1)·√2/4 on n columns. Actions are `UP, RIGHT, DOWN, LEFT, SAMPLE`, observations the
integers `1:2^K`: one of good and bad for every rock, the first rock of the greatest weight, good before bad.
"""
struct FieldVision{K} <: POMDP{RockState{K},Int,Int}
    base::RockSample{K}
end

function FieldVision(rocks::AbstractVector; columns::Integer = 7, keywords...)
    return FieldVision(RockSample(rocks; columns, half_efficiency_distance = (columns - 1) * sqrt(2) / 4, keywords...))
end

# --- the POMDPs.jl interface ---

POMDPs.states(m::FieldVision) = states(m.base)
POMDPs.stateindex(m::FieldVision, s::RockState) = stateindex(m.base, s)
POMDPs.actions(::FieldVision) = UP:SAMPLE
POMDPs.actions(m::FieldVision, s::RockState) = filter(<=(SAMPLE), actions(m.base, s))
POMDPs.actionindex(::FieldVision, a::Int) = a
POMDPs.observations(::FieldVision{K}) where {K} = 1:(2^K)
POMDPs.obsindex(::FieldVision, o::Int) = o
POMDPs.discount(m::FieldVision) = discount(m.base)
POMDPs.isterminal(m::FieldVision, s::RockState) = isterminal(m.base, s)
POMDPs.initialstate(m::FieldVision) = initialstate(m.base)
POMDPs.transition(m::FieldVision, s::RockState, a::Int) = transition(m.base, s, a)
POMDPs.reward(m::FieldVision, s::RockState, a::Int, sp::RockState) = reward(m.base, s, a, sp)
POMDPs.reward(m::FieldVision, s::RockState, a::Int) = reward(m.base, s, a)

POMDPs.observation(m::FieldVision, s::RockState, a::Int, sp::RockState) = observation(m, a, sp)
function POMDPs.observation(m::FieldVision{K}, a::Int, sp::RockState{K}) where {K}
    probabilities = isterminal(m, sp) ? [o == 1 ? 1.0 : 0.0 for o in observations(m)] :
                    [prod(j -> pdf(sensor_reading(m, j, a, sp), sensor_label(m, j, o)), 1:K; init = 1.0) for o in observations(m)]
    return SparseCat(observations(m), probabilities)
end

# --- the harness interface: as RockSample's, with a sensor for every rock ---

nvisible(m::FieldVision) = nvisible(m.base)
visible_index(m::FieldVision, s::RockState) = visible_index(m.base, s)
visible_names(m::FieldVision) = visible_names(m.base)
visible_values(m::FieldVision, v) = visible_values(m.base, v)

factor_sizes(m::FieldVision) = factor_sizes(m.base)
factor_names(m::FieldVision) = factor_names(m.base)
factor_labels(m::FieldVision, k) = factor_labels(m.base, k)
factor_value(m::FieldVision, s::RockState, k) = factor_value(m.base, s, k)
relevant_factor(m::FieldVision, v) = 0
relevant_factor(m::FieldVision, v, a::Int) = relevant_factor(m.base, v, a)
assemble(m::FieldVision, v, values) = assemble(m.base, v, values)

sensor_factors(::FieldVision{K}) where {K} = ntuple(identity, Val(K))
sensor_sizes(::FieldVision{K}) where {K} = ntuple(_ -> 2, Val(K))
sensor_names(::FieldVision{K}) where {K} = string.(1:K)
sensor_labels(::FieldVision, j) = ["good", "bad"]
own_reading(::FieldVision, s, a, sp) = Deterministic(1)
function sensor_reading(m::FieldVision, j, a, sp::RockState)
    right = m.base.accuracy[cell_index(m.base, sp.x, sp.y), j]
    return SparseCat((1, 2), sp.good[j] ? (right, 1 - right) : (1 - right, right))
end

belief_features(m::FieldVision) = belief_features(m.base)
action_names(m::FieldVision) = action_names(m.base)[UP:SAMPLE]
observation_names(m::FieldVision{K}) where {K} =
    [join((sensor_labels(m, j)[sensor_label(m, j, o)] for j in 1:K), " ") for o in observations(m)]
action_at(::FieldVision, i) = i
observation_at(::FieldVision, i) = i
layout(m::FieldVision) = layout(m.base)
