"""
    solve_qmdp(m; tolerance = 1e-9)

QMDP (Littman, Cassandra and Kaelbling 1995) through QMDP.jl, value iteration to a Bellman residual of `tolerance`:
the alpha vectors, and what to record with them.
"""
function solve_qmdp(m::POMDP; tolerance::Real = 1e-9)
    solver = QMDPSolver(SparseValueIterationSolver(; max_iterations = 100_000, belres = tolerance, include_Q = true))
    policy = solve(solver, m)
    fill_unlisted!(m, policy)
    return AlphaVectors(m, policy), Dict{String,Any}("solver" => "QMDP.jl", "tolerance" => tolerance)
end

"Value iteration looks only at `actions(m, s)`; here the others get their one-step lookahead value."
function fill_unlisted!(m, policy)
    ordered = ordered_states(m)
    utility = [isterminal(m, s) ? 0.0 : maximum(policy.alphas[actionindex(m, a)][i] for a in actions(m, s))
               for (i, s) in enumerate(ordered)]
    for (i, s) in enumerate(ordered), a in actions(m)
        !isterminal(m, s) && a in actions(m, s) && continue
        policy.alphas[actionindex(m, a)][i] = lookahead(m, s, a, utility)
    end
end
