"""
    solve_native_sarsop(m; timeout = 600, precision = 1e-3, tolerance = 1e-9)

NativeSARSOP.jl on all states of the model, for models without hidden factors to exploit. Both initial bounds are
solved to a residual of `tolerance` with no time limit: by default they stop after a second, and an upper bound
stopped early, which grows from 0, is no bound.
"""
function solve_native_sarsop(m::POMDP; timeout::Real = 600, precision::Real = 1e-3, tolerance::Real = 1e-9)
    upper = NativeSARSOP.FastInformedBound(; max_iter = 100_000, max_time = Inf, bel_res = tolerance)
    lower = NativeSARSOP.BlindLowerBound(; max_iter = 100_000, max_time = Inf, bel_res = tolerance)
    solver = NativeSARSOP.SARSOPSolver(; max_time = Float64(timeout), precision = Float64(precision), verbose = false, init_lower = lower, init_upper = upper)
    started = time()
    policy, info = POMDPTools.solve_info(solver, with_visible(m))
    record = Dict{String,Any}(
        "solver" => "NativeSARSOP.jl", "timeout" => timeout, "precision" => precision, "tolerance" => tolerance,
        "seconds" => time() - started, "lower" => info.tree.V_lower[1], "upper" => info.tree.V_upper[1],
    )
    return AlphaVectors(m, policy), record
end

"The model with its visible part among the observations, for solvers that know of no visible part."
with_visible(m::POMDP) = m
