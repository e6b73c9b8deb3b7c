using MOMDPs, POMDPs, POMDPTools

"A corridor of three cells, x, that ends in a fourth at random; which door of it pays is hidden, y. Pushing may change it."
struct Doors <: MOMDP{Int,Int,Int,Int} end
MOMDPs.states_x(::Doors) = 1:4
MOMDPs.states_y(::Doors) = 1:2
MOMDPs.stateindex_x(::Doors, s::Tuple{Int,Int}) = s[1]
MOMDPs.stateindex_y(::Doors, s::Tuple{Int,Int}) = s[2]
MOMDPs.stateindex_x(::Doors, x::Int) = x
MOMDPs.stateindex_y(::Doors, y::Int) = y
MOMDPs.initialstate_x(::Doors) = SparseCat([1, 2], [0.5, 0.5])
MOMDPs.initialstate_y(::Doors, x::Int) = SparseCat([1, 2], [0.3, 0.7])
MOMDPs.transition_x(::Doors, s::Tuple{Int,Int}, a::Int) =
    s[1] == 4 ? Deterministic(4) : SparseCat([s[1], s[1] + 1], s[2] == a ? [0.2, 0.8] : [0.6, 0.4])
MOMDPs.transition_y(::Doors, s::Tuple{Int,Int}, a::Int, xp::Int) =
    xp == s[1] ? SparseCat([s[2], 3 - s[2]], [0.9, 0.1]) : Deterministic(s[2])
POMDPs.actions(::Doors) = 1:2
POMDPs.actionindex(::Doors, a::Int) = a
POMDPs.observations(::Doors) = 1:2
POMDPs.obsindex(::Doors, o::Int) = o
POMDPs.observation(::Doors, a::Int, s::Tuple{Int,Int}) = SparseCat([s[2], 3 - s[2]], s[1] == 2 ? [0.9, 0.1] : [0.6, 0.4])
POMDPs.reward(::Doors, s::Tuple{Int,Int}, a::Int) = s[1] == 4 ? 0.0 : s[2] == a ? 1.0 : -1.0
POMDPs.discount(::Doors) = 0.9
POMDPs.isterminal(::Doors, s::Tuple{Int,Int}) = s[1] == 4

"The same, but whether it has ended lies with what is hidden too."
struct Sudden <: MOMDP{Int,Int,Int,Int} end
for verb in (:states_x, :states_y)
    @eval MOMDPs.$verb(::Sudden) = $verb(Doors())
end
MOMDPs.stateindex_x(::Sudden, s) = stateindex_x(Doors(), s)
MOMDPs.stateindex_y(::Sudden, s) = stateindex_y(Doors(), s)
MOMDPs.initialstate_x(::Sudden) = initialstate_x(Doors())
MOMDPs.initialstate_y(::Sudden, x::Int) = initialstate_y(Doors(), x)
MOMDPs.transition_x(::Sudden, s::Tuple{Int,Int}, a::Int) = transition_x(Doors(), s, a)
MOMDPs.transition_y(::Sudden, s::Tuple{Int,Int}, a::Int, xp::Int) = transition_y(Doors(), s, a, xp)
for verb in (:actions, :observations, :discount)
    @eval POMDPs.$verb(::Sudden) = $verb(Doors())
end
POMDPs.actionindex(::Sudden, a::Int) = a
POMDPs.obsindex(::Sudden, o::Int) = o
POMDPs.observation(::Sudden, a::Int, s::Tuple{Int,Int}) = observation(Doors(), a, s)
POMDPs.reward(::Sudden, s::Tuple{Int,Int}, a::Int) = reward(Doors(), s, a)
POMDPs.isterminal(::Sudden, s::Tuple{Int,Int}) = s == (4, 1)
