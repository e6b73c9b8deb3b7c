"The joint belief of a factored one, as POMDPTools orders states."
dense(m, b) = [pdf(b, s) for s in states(m)]

"Largest difference between FactoredUpdater and DiscreteUpdater over random histories."
function worst_difference(m, rng, histories, steps; avoid = Int[])
    exact, reference = FactoredUpdater(m), DiscreteUpdater(m)
    worst = 0.0
    for _ in 1:histories
        s = rand(rng, initialstate(m))
        b, r = initialize_belief(exact, initialstate(m)), initialize_belief(reference, initialstate(m))
        for _ in 1:steps
            a = rand(rng, setdiff(actions(m, s), avoid))
            sp = rand(rng, transition(m, s, a))
            isterminal(m, sp) && break
            o = rand(rng, observation(m, a, sp))
            b, r = update(exact, b, a, o), update(reference, r, a, o)
            worst = max(worst, maximum(abs.(dense(m, b) .- r.b)))
            s = sp
        end
    end
    return worst
end

@testset "agrees with DiscreteUpdater" begin
    rng = MersenneTwister(11)
    @test worst_difference(SMALL_ROCKS, rng, 200, 40) < 1e-12
    @test worst_difference(SMALL_BORDER, rng, 50, 40) < 1e-12
    # cooperate() may end the episode; that it did not is known here, and unknown to DiscreteUpdater
    @test worst_difference(SMALL_HIDDEN, rng, 100, 40; avoid = [COOPERATE]) < 1e-12
    @test worst_difference(instance("rocksample-7x8").make(), rng, 3, 15) < 1e-12
end

@testset "equations 1 to 3 of the paper" begin
    m = instance("rocksample-7x8").make()
    up = FactoredUpdater(m)
    b = initialize_belief(up, initialstate(m))
    p = 0.5
    for (o, i) in ((:good, 3), (:good, 3), (:bad, 3), (:good, 3), (:bad, 3))
        λ = 0.5 + 0.5 * 2^(-hypot(4 - 1, 2 - 4) / 20)
        p = o == :good ? λ * p / ((1 - λ) * (1 - p) + λ * p) : (1 - λ) * p / ((1 - λ) * p + λ * (1 - p))
        b = update(up, b, check(i), o)
        @test H.marginal(b, i, 2) ≈ p atol = 1e-14
        @test all(H.marginal(b, j, 2) == 0.5 for j in 1:8 if j != i)
    end
    for a in (RIGHT, RIGHT, DOWN, DOWN, DOWN)      # to rock 1 at (3, 1)
        b = update(up, b, a, :none)
    end
    @test b.visible == H.cell_index(m, 3, 1)
    b = update(up, b, SAMPLE, :none)
    @test H.marginal(b, 1, 2) == 0
    @test H.marginal(b, 3, 2) ≈ p atol = 1e-14
end

@testset "as a distribution" begin
    up = FactoredUpdater(SMALL_ROCKS)
    b = update(up, initialize_belief(up, initialstate(SMALL_ROCKS)), check(1), :good)
    @test sum(dense(SMALL_ROCKS, b)) ≈ 1
    @test length(support(b)) == 8
    rng = MersenneTwister(2)
    share = count(_ -> rand(rng, b).good[1], 1:20_000) / 20_000
    @test abs(share - H.marginal(b, 1, 2)) < 5 * 0.5 / sqrt(20_000)
end

@testset "which updater for which model" begin
    @test belief_updater(SMALL_ROCKS) isa FactoredUpdater
    @test belief_updater(SMALL_HIDDEN) isa FactoredUpdater
    @test belief_updater(Tiger()) isa DiscreteUpdater
end


@testset "a model that names a state outside its space is an error, not a stray write" begin
    m = H.harnessed(Astray())
    @test_throws BoundsError H.bayes!(zeros(2), [0.5, 0.5], m, 1, :go, 1, true, 1)
end
