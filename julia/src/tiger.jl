# Tiger: A. Cassandra, L. Kaelbling and M. Littman, "Acting Optimally in Partially Observable Stochastic Domains", AAAI 1994.

const TIGER_SIDES = (:left, :right)

"""
    Tiger(; keywords...)

Behind one of two doors is a tiger. Listening tells which one, wrongly at times; after a door was opened the tiger is
anywhere again.

| keyword | default | meaning |
|:--|:--|:--|
| `accuracy` | 0.85 | probability that listening is right |
| `listen_reward` | −1 | of listening |
| `tiger_reward`, `escape_reward` | −100, 10 | of opening the tiger's door, and the other |
| `discount` | 0.95 | |

States are 1 and 2, the tiger left and right; actions 1 to 3: listen, open left, open right; observations 1 and 2: the
tiger heard left, heard right, as likely as not after a door.
"""
struct Tiger <: POMDP{Int,Int,Int}
    accuracy::Float64
    listen_reward::Float64
    tiger_reward::Float64
    escape_reward::Float64
    discount::Float64
end
Tiger(; accuracy = 0.85, listen_reward = -1.0, tiger_reward = -100.0, escape_reward = 10.0, discount = 0.95) =
    Tiger(accuracy, listen_reward, tiger_reward, escape_reward, discount)

POMDPs.states(::Tiger) = 1:2
POMDPs.stateindex(::Tiger, s::Int) = s
POMDPs.actions(::Tiger) = 1:3
POMDPs.actionindex(::Tiger, a::Int) = a
POMDPs.observations(::Tiger) = 1:2
POMDPs.obsindex(::Tiger, o::Int) = o
POMDPs.discount(m::Tiger) = m.discount
POMDPs.isterminal(::Tiger, s::Int) = false
POMDPs.initialstate(::Tiger) = SparseCat(1:2, (0.5, 0.5))
POMDPs.transition(::Tiger, s::Int, a::Int) = SparseCat(1:2, a > 1 ? (0.5, 0.5) : s == 1 ? (1.0, 0.0) : (0.0, 1.0))
POMDPs.observation(m::Tiger, s::Int, a::Int, sp::Int) = observation(m, a, sp)
function POMDPs.observation(m::Tiger, a::Int, sp::Int)
    a > 1 && return SparseCat(1:2, (0.5, 0.5))
    right, wrong = m.accuracy, 1 - m.accuracy
    return SparseCat(1:2, sp == 1 ? (right, wrong) : (wrong, right))
end
POMDPs.reward(m::Tiger, s::Int, a::Int, sp::Int) = reward(m, s, a)
POMDPs.reward(m::Tiger, s::Int, a::Int) = a == 1 ? m.listen_reward : a - 1 == s ? m.tiger_reward : m.escape_reward

action_names(::Tiger) = ["listen()", "open_left()", "open_right()"]
observation_names(::Tiger) = collect(String.(TIGER_SIDES))
state_names(::Tiger) = collect(String.(TIGER_SIDES))
