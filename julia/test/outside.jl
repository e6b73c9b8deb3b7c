# Policies that live elsewhere, in POMDPs.jl's own simulators.

@testset "what is seen is handed over in 0-based indices" begin
    m = SMALL_ROCKS
    calls = Any[]
    policy = OutsidePolicy(m, (arguments...) -> (push!(calls, deepcopy(arguments)); fill(actionindex(m, first(actions(m))), 1)))
    for (model, seen) in ((m, calls),)
        history = simulate(HistoryRecorder(; max_steps = 5, rng = Xoshiro(1)), model, policy)
        states_seen = collect(state_hist(history))
        @test [c[1] for c in seen] == collect(0:(length(seen) - 1))
        @test all(only(c[2]) == H.visible_index(m, s) - 1 for (c, s) in zip(seen, states_seen))
        @test only(seen[1][3]) == -1
        @test all(only(c[3]) == obsindex(m, o) - 1 for (c, o) in zip(seen[2:end], observation_hist(history)))
        @test size(seen[1][4]) == (1, H.nmarginals(m))
    end
end

@testset "a batch is one call; stopping is refused" begin
    m = Tiger()
    calls = Ref(0)
    policy = OutsidePolicy(m, (step, v, o, b) -> (calls[] += 1; [p > 0.5 ? 1 : 2 for p in b[:, 1]]))
    up = updater(policy)
    beliefs = [initialize_belief(up, BoolDistribution(p)) for p in (0.9, 0.1)]
    @test action(policy, beliefs) == [:left, :right]
    @test calls[] == 1
    @test_throws r"same step" action(policy, [beliefs[1], update(up, beliefs[2], :listen, true)])
    stopping = OutsidePolicy(m, (arguments...) -> [-1])
    @test_throws r"stops here" action(stopping, beliefs[1])
end

# Needs PythonCall with a Python that has the harness: JULIA_PYTHONCALL_EXE says which.
if Base.find_package("PythonCall") === nothing || !haskey(ENV, "JULIA_PYTHONCALL_EXE")
    @info "no policies of Python are tried: PythonCall or JULIA_PYTHONCALL_EXE is missing"
else
    @eval using PythonCall
    @testset "a program found by evolution earns in Julia what it earns in Python" begin
        m = instance("rocksample-7x8").make()
        policy = python_policy(m, "rocksample-7x8", "ge-feedback")
        n = 200
        returns = [simulate(RolloutSimulator(; max_steps = 50, rng = Xoshiro(k)), m, policy) for k in 1:n]
        score = pyimport("harness").evaluate("rocksample-7x8", "ge-feedback"; episodes = 2000, engine = "tables").score
        expected, sem = pyconvert(Float64, score.discounted_mean), pyconvert(Float64, score.discounted_sem)
        mean = sum(returns) / n
        @test abs(mean - expected) < 4 * hypot(sqrt(sum(abs2, returns .- mean)) / n, sem)
    end
end
