# Two models that know nothing of the harness.

"Tiger (Kaelbling, Littman and Cassandra 1998): the tiger is left (true) or right; listening is right with 0.85."
struct Tiger <: POMDP{Bool,Symbol,Bool} end
POMDPs.states(::Tiger) = (true, false)
POMDPs.stateindex(::Tiger, s::Bool) = s ? 1 : 2
POMDPs.actions(::Tiger) = (:listen, :left, :right)
POMDPs.actionindex(::Tiger, a::Symbol) = findfirst(==(a), (:listen, :left, :right))
POMDPs.observations(::Tiger) = (true, false)
POMDPs.obsindex(::Tiger, o::Bool) = o ? 1 : 2
POMDPs.discount(::Tiger) = 0.95
POMDPs.initialstate(::Tiger) = BoolDistribution(0.5)
POMDPs.transition(::Tiger, s::Bool, a::Symbol) = BoolDistribution(a == :listen ? Float64(s) : 0.5)
POMDPs.observation(::Tiger, a::Symbol, sp::Bool) = BoolDistribution(a != :listen ? 0.5 : sp ? 0.85 : 0.15)
POMDPs.reward(::Tiger, s::Bool, a::Symbol) = a == :listen ? -1.0 : (a == :left) == s ? -100.0 : 10.0

"A random walk whose next state comes in a support that is not in index order, and which ends at random."
struct Drift <: POMDP{Int,Symbol,Bool} end
POMDPs.states(::Drift) = 1:4
POMDPs.stateindex(::Drift, s::Int) = s
POMDPs.actions(::Drift) = (:go, :stay)
POMDPs.actionindex(::Drift, a::Symbol) = a == :go ? 1 : 2
POMDPs.observations(::Drift) = (false, true)
POMDPs.obsindex(::Drift, o::Bool) = o + 1
POMDPs.discount(::Drift) = 0.9
POMDPs.isterminal(::Drift, s::Int) = s == 4
POMDPs.initialstate(::Drift) = SparseCat([2, 1], [0.7, 0.3])
POMDPs.transition(::Drift, s::Int, a::Symbol) =
    a == :go && s < 4 ? SparseCat([s + 1, s], [0.6, 0.4]) : SparseCat([s, s], [1.0, 0.0])
POMDPs.observation(::Drift, a::Symbol, sp::Int) = BoolDistribution(sp / 4)
POMDPs.reward(::Drift, s::Int, a::Symbol, sp::Int) = Float64(sp - s)
POMDPs.reward(::Drift, s::Int, a::Symbol) = a == :go && s < 4 ? 0.6 : 0.0

"""
A corridor of three cells whose state type is `T`, a `Union` with `TerminalState` or `Any`; from the last cell it ends.
As POMDPs.jl allows, it does not say what is paid, seen or done after the end.
"""
struct Corridor{T} <: POMDP{T,Symbol,Int} end
POMDPs.states(::Corridor) = [1, 2, 3, terminalstate]
POMDPs.stateindex(::Corridor, s::Int) = s
POMDPs.stateindex(::Corridor, ::TerminalState) = 4
POMDPs.actions(::Corridor) = (:go, :stay)
POMDPs.actionindex(::Corridor, a::Symbol) = a == :go ? 1 : 2
POMDPs.observations(::Corridor) = (1, 2)
POMDPs.obsindex(::Corridor, o::Int) = o
POMDPs.discount(::Corridor) = 0.9
POMDPs.initialstate(::Corridor) = SparseCat(Any[1, 2], [0.5, 0.5])
POMDPs.transition(::Corridor, s::Int, a::Symbol) = Deterministic(a == :stay ? s : s < 3 ? s + 1 : terminalstate)
POMDPs.observation(::Corridor, ::Symbol, sp::Int) = SparseCat([1, 2], [sp / 4, 1 - sp / 4])
POMDPs.observation(::Corridor, ::Symbol, ::TerminalState) = Deterministic(2)
POMDPs.reward(::Corridor, s::Int, a::Symbol) = a == :go && s == 3 ? 1.0 : 0.0

"A model that is wrong: its third state is not among its states."
struct Astray <: POMDP{Int,Symbol,Bool} end
POMDPs.states(::Astray) = 1:2
POMDPs.stateindex(::Astray, s::Int) = s
POMDPs.actions(::Astray) = (:go,)
POMDPs.actionindex(::Astray, ::Symbol) = 1
POMDPs.observations(::Astray) = (true,)
POMDPs.obsindex(::Astray, ::Bool) = 1
POMDPs.discount(::Astray) = 0.9
POMDPs.transition(::Astray, s::Int, ::Symbol) = Deterministic(s + 1)
POMDPs.observation(::Astray, ::Symbol, ::Int) = Deterministic(true)
POMDPs.reward(::Astray, s::Int, ::Symbol) = 0.0
