# Solved policies as alpha vectors over the hidden part, grouped by visible value: what Python evaluates.

"""
    AlphaVectors

Alpha vectors of a policy: `values[i, h]` is the value of joint hidden index `h` (last factor fastest) under vector
`i`, which holds for visible value `visible[i]` and starts with action index `actions[i]`. Sorted by visible value.
"""
struct AlphaVectors
    visible::Vector{Int}
    actions::Vector{Int}
    values::Matrix{Float32}
end

"Alpha vectors over the hidden part from a POMDPTools policy over all states of the model."
function AlphaVectors(m::POMDP, policy::AlphaVectorPolicy)
    vectors = Tuple{Int,Int,Vector{Float64}}[]
    for v in 1:nvisible(m)
        is_terminal_value(m, v) && continue
        columns = [stateindex(m, assemble(m, v, joint_values(m, h))) for h in 1:joint_size(m)]
        for (alpha, a) in zip(policy.alphas, policy.action_map)
            push!(vectors, (v, actionindex(m, a), alpha[columns]))
        end
    end
    return AlphaVectors(m, vectors)
end

"""
Alpha vectors of any other policy that has a `value` at states: one an action, what the action is worth if the state were
seen after it and `value` held from there. Played, that is QMDP by the policy's values.
"""
function AlphaVectors(m::POMDP, policy::Policy)
    applicable(value, policy, first(ordered_states(m))) || throw(
        ArgumentError(
            "a $(nameof(typeof(policy))) has neither alpha vectors nor a value at states to store; play the file itself " *
            "(--policy FILE.jl)",
        ),
    )
    utility = [isterminal(m, s) ? 0.0 : Float64(value(policy, s)) for s in ordered_states(m)]
    vectors = Tuple{Int,Int,Vector{Float64}}[]
    for v in 1:nvisible(m)
        is_terminal_value(m, v) && continue
        hidden = [assemble(m, v, joint_values(m, h)) for h in 1:joint_size(m)]
        for a in actions(m)
            push!(vectors, (v, actionindex(m, a), [lookahead(m, s, a, utility) for s in hidden]))
        end
    end
    return AlphaVectors(m, vectors)
end

"What action `a` is worth in state `s` where `utility[stateindex(m, sp)]` is what comes after it."
function lookahead(m::POMDP, s, a, utility)
    isterminal(m, s) && return 0.0
    return sum(
        p * (reward(m, s, a, sp) + discount(m) * utility[stateindex(m, sp)]) for
        (sp, p) in weighted_iterator(transition(m, s, a))
    )
end

function AlphaVectors(m::POMDP, vectors::Vector{Tuple{Int,Int,Vector{Float64}}})
    kept = eltype(vectors)[]
    for v in 1:nvisible(m)
        append!(kept, undominated([t for t in vectors if t[1] == v]))
    end
    values = isempty(kept) ? zeros(Float32, 0, joint_size(m)) : Float32.(stack(last.(kept); dims = 1))
    return AlphaVectors(first.(kept), getindex.(kept, 2), values)
end

"The vectors that no other one reaches or exceeds everywhere; of equal ones the first stays."
function undominated(vectors)
    order = sortperm(vectors; by = t -> -sum(t[3]))
    kept = Int[]
    for i in order
        any(j -> all(vectors[j][3] .>= vectors[i][3]), kept) || push!(kept, i)
    end
    return vectors[sort!(kept)]
end

"Value of the initial belief (before the first reading) under the alpha vectors."
function initial_value(m::POMDP, alpha::AlphaVectors)
    total = 0.0
    weights = Dict{Int,Vector{Float64}}()
    for (s, p) in weighted_iterator(initialstate(m))
        w = get!(() -> zeros(joint_size(m)), weights, visible_index(m, s))
        w[joint_index(m, s)] += p
    end
    for (v, w) in weights
        total += maximum(alpha.values[i, :]' * w for i in eachindex(alpha.visible) if alpha.visible[i] == v)
    end
    return total
end

"Joint hidden index of state `s`; inverse of `joint_values`."
joint_index(m, s) =
    1 + foldl((h, k) -> h * factor_sizes(m)[k] + factor_value(m, s, k) - 1, eachindex(factor_sizes(m)); init = 0)
