# Tiger (Kaelbling, Littman and Cassandra 1998), as any model of POMDPs.jl is written. It knows nothing of the harness.
#
# A tiger is behind one of two doors, treasure behind the other. Listening costs 1 and is right 85 times in a hundred.
# Opening the tiger's door costs 100, the other one pays 10; then the tiger is put behind a door at random once more.
using POMDPs, POMDPTools

struct Tiger <: POMDP{Symbol,Symbol,Symbol} end # types of a state, an action and an observation

const STATES = (:tiger_left, :tiger_right)
const ACTIONS = (:listen, :open_left, :open_right)
const READINGS = (:left, :right)

POMDPs.states(::Tiger) = STATES
POMDPs.actions(::Tiger) = ACTIONS
POMDPs.observations(::Tiger) = READINGS
POMDPs.stateindex(::Tiger, s::Symbol) = findfirst(==(s), STATES)
POMDPs.actionindex(::Tiger, a::Symbol) = findfirst(==(a), ACTIONS)
POMDPs.obsindex(::Tiger, o::Symbol) = findfirst(==(o), READINGS)
POMDPs.discount(::Tiger) = 0.95
POMDPs.initialstate(::Tiger) = Uniform(STATES)

POMDPs.transition(::Tiger, s::Symbol, a::Symbol) = a == :listen ? Deterministic(s) : Uniform(STATES)

function POMDPs.observation(::Tiger, a::Symbol, sp::Symbol)
    heard_left = a != :listen ? 0.5 : sp == :tiger_left ? 0.85 : 0.15
    return SparseCat(READINGS, (heard_left, 1 - heard_left))
end

function POMDPs.reward(::Tiger, s::Symbol, a::Symbol)
    a == :listen && return -1.0
    return (s, a) in ((:tiger_left, :open_left), (:tiger_right, :open_right)) ? -100.0 : 10.0
end

Tiger() # the model: the value of the file's last line
