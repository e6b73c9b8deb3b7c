# The value of the fully observed problem: no policy that must estimate the hidden part can do better.

"""
    mdp_bound(m; horizon = 50, tolerance = 1e-9)

Values of the fully observed problem at the initial distribution: `discounted`, over an infinite horizon (value
iteration to a Bellman residual of `tolerance`), and `undiscounted`, over `horizon` steps (backward induction).
"""
function mdp_bound(m::POMDP; horizon::Integer = 50, tolerance::Real = 1e-9)
    solver = SparseValueIterationSolver(; max_iterations = 100_000, belres = tolerance)
    utility = solve(solver, UnderlyingMDP(m)).util
    return (;
        discounted = mean_at_start(m, utility), undiscounted = mean_at_start(m, finite_horizon_utility(m, horizon)),
        horizon, tolerance,
    )
end

mean_at_start(m, utility) = sum(p * utility[stateindex(m, s)] for (s, p) in weighted_iterator(initialstate(m)))

"Undiscounted optimal return of the fully observed problem within `horizon` steps, for every state."
function finite_horizon_utility(m::POMDP, horizon::Integer)
    utility = zeros(length(states(m)))
    for _ in 1:horizon
        utility = [optimal_backup(m, s, utility) for s in states(m)]
    end
    return utility
end

function optimal_backup(m, s, utility)
    isterminal(m, s) && return 0.0
    return maximum(actions(m)) do a
        sum(p * (reward(m, s, a, sp) + utility[stateindex(m, sp)]) for (sp, p) in weighted_iterator(transition(m, s, a)))
    end
end
