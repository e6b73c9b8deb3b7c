"Buffers of a simulator, as Python makes them."
function buffers(m, E; track = true)
    return (
        u = zeros(E), actions = zeros(Int32, E), rewards = zeros(E), visible = zeros(Int32, E),
        observation = zeros(Int32, E), done = zeros(Bool, E), marginals = zeros(E, track ? H.nmarginals(m) : 0),
    )
end

@testset "draw: inverse CDF in index order" begin
    d = SparseCat([3, 1, 2], [0.5, 0.2, 0.3])       # not in index order
    @test [first(H.draw(d, u, identity)) for u in (0.0, 0.19, 0.2, 0.49, 0.5, 0.999999, 1.0)] == [1, 1, 2, 2, 3, 3, 3]
    d = SparseCat((:a, :b, :c), (0.25, 0.0, 0.75))
    index(x) = findfirst(==(x), (:a, :b, :c))
    @test [first(H.draw(d, u, index)) for u in (0.0, 0.2499, 0.25, 0.99)] == [:a, :a, :c, :c]
    @test H.draw(Deterministic(7), 0.3, identity) == (7, 0.3)
    # What is left of u is its place within the value's share.
    @test H.draw(SparseCat([1, 2], [0.25, 0.75]), 0.125, identity) == (1, 0.5)
    @test H.draw(SparseCat([1, 2], [0.25, 0.75]), 0.625, identity) == (2, 0.5)
    @test H.draw(SparseCat([2, 1], [0.75, 0.25]), 0.625, identity) == (2, 0.5)
    @test H.sorted_outcomes(SparseCat([2, 1, 2], [0.2, 0.5, 0.3]), identity) == [1 => 0.5, 2 => 0.5]
end

@testset "steps as the model's functions say, on $(typeof(m))" for m in [
    SMALL; FieldVision([(2, 1), (3, 3)]; columns = 3); H.Flat(Tiger()); H.Flat(Drift()); H.Flat(Corridor{Union{Int,TerminalState}}()); H.Flat(Corridor{Any}())
]
    rng = MersenneTwister(7)
    E = 64
    b = buffers(m, E)
    sim = H.Simulator(m, b)
    rand!(rng, b.u)
    H.reset!(sim)
    beliefs = [copy(b.marginals[e, :]) for e in 1:E]
    for _ in 1:30
        before, done = copy(sim.states), copy(b.done)
        rand!(rng, b.u)
        b.actions .= rand(rng, 0:(length(actions(m)) - 1), E)
        H.step!(sim)
        for e in 1:E
            if done[e]
                @test b.rewards[e] == 0 && sim.states[e] == before[e]
                continue
            end
            s, a, sp = before[e], ordered_actions(m)[b.actions[e] + 1], sim.states[e]
            o = ordered_observations(m)[b.observation[e] + 1]
            @test pdf(transition(m, s, a), sp) > 0
            @test pdf(observation(m, s, a, sp), o) > 0
            @test b.rewards[e] == reward(m, s, a, sp)
            @test b.visible[e] == H.visible_index(m, sp) - 1
            @test b.done[e] == isterminal(m, sp)
        end
        @test all(sum(b.marginals[e, H.offset(m, k) .+ (1:n)]) ≈ 1 for e in 1:E for (k, n) in enumerate(H.factor_sizes(m)))
    end
end

@testset "a generic model: Tiger's belief is DiscreteUpdater's" begin
    tiger = Tiger()
    m = H.harnessed(tiger)
    @test m isa H.Flat
    rng = MersenneTwister(9)
    b = buffers(m, 1)
    sim = H.Simulator(m, b)
    rand!(rng, b.u)
    H.reset!(sim)
    up = DiscreteUpdater(tiger)
    belief = initialize_belief(up, initialstate(tiger))
    for _ in 1:20
        rand!(rng, b.u)
        b.actions[1] = rand(rng, 0:(length(actions(tiger)) - 1))
        H.step!(sim)
        belief = update(up, belief, ordered_actions(tiger)[b.actions[1] + 1], ordered_observations(tiger)[b.observation[1] + 1])
        @test b.marginals[1, :] ≈ belief.b atol = 1e-12
    end
end

@testset "large models are not enumerated" begin
    m = instance("rocksample-15x15").make()
    @test length(states(m)) == 15 * 15 * 2^15 + 1
    b = buffers(m, 2000)
    sim = H.Simulator(m, b)
    rng = MersenneTwister(1)
    rand!(rng, b.u)
    H.reset!(sim)
    @test @elapsed(for _ in 1:10
        rand!(rng, b.u)
        b.actions .= rand(rng, 0:(length(actions(m)) - 1), 2000)
        H.step!(sim)
    end) < 60      # an enumeration of 7.4 million states a step would take minutes
end

@testset "buffers of the wrong size are refused" begin
    @test_throws DimensionMismatch H.Simulator(SMALL_ROCKS, merge(buffers(SMALL_ROCKS, 4), (; u = zeros(3))))
    @test_throws DimensionMismatch H.Simulator(SMALL_ROCKS, merge(buffers(SMALL_ROCKS, 4), (; marginals = zeros(4, 2))))
end

@testset "no allocation an episode and step" begin
    for name in ("rocksample-7x8", "bordercross-7x8-random", "fieldvision-rocksample-5x5")
        m = instance(name).make()
        stepped(E) = begin
            b = buffers(m, E)
            sim = H.Simulator(m, b)
            H.reset!(sim)
            H.step!(sim)
            return @allocated H.step!(sim)
        end
        stepped(1000)
        @test stepped(100_000) - stepped(1000) < 10_000
    end
end
