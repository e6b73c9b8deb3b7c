@testset "$(x.name)" for x in H.INSTANCES
    m = x.make()
    @test x.version >= 1 && length(x.history) == x.version
    @test all(isfile, joinpath.(pkgdir(PomdpHarness), "src", x.sources))
    @test length(H.source_hash(x.sources)) == 64
    @test instance(x.name) === x
end
@test_throws ArgumentError instance("rocksample-7x7")

@testset "layouts" begin
    m = instance("rocksample-7x8").make()
    @test m.rocks == [(3, 1), (1, 2), (4, 2), (7, 4), (3, 5), (4, 5), (6, 6), (2, 7)]
    @test m.starts == [(1, 4)]
    @test length(states(instance("rocksample-11x11").make())) == 247_809
    @test length(states(instance("rocksample-20x20").make())) == 400 * 2^20 + 1
    @test setdiff(instance("rocksample-11x11").make().rocks, instance("rocksample-10x10").make().rocks) == [(3, 5)]
end

@testset "rule sets of RockSample" begin
    start(name) = first(support(initialstate(instance(name).make())))
    next(m, s, a) = only(support(transition(m, s, a)))
    @testset "ZMDP: −100 and the end, for a sample where no rock is too" begin
        m = instance("rocksample-7x8@zmdp").make()
        s = start("rocksample-7x8@zmdp")
        for a in (LEFT, SAMPLE)
            @test reward(m, s, a) == -100 && isterminal(m, next(m, s, a)) && !(a in actions(m, s))
        end
        on_rock = RockState{8}(3, 1, fill(true, 8))
        @test reward(m, on_rock, SAMPLE) == 10 && SAMPLE in actions(m, on_rock)
        @test !isterminal(m, next(m, on_rock, SAMPLE))
    end
    @testset "ZMDP: sensors of the small maps" begin
        # gen_RockSample_4_4 has the efficiency exp(−d), gen_RockSample_5_5 2^(−d/4), the others 2^(−d/20)
        for (name, η) in ("4x4" => exp(-2), "5x5" => 2^(-2 / 4), "5x7" => 2^(-2 / 20))
            m = instance("rocksample-$name@zmdp").make()
            x, y = m.rocks[1]
            cell = H.cell_index(m, x > 2 ? x - 2 : x + 2, y)
            @test m.accuracy[cell, 1] ≈ 0.5 + 0.5η
        end
    end
    @testset "RockSample.jl: a move off the grid is free, the start in the corner" begin
        m = instance("rocksample-7x8@rocksample.jl").make()
        s = start("rocksample-7x8@rocksample.jl")
        @test (s.x, s.y) == (1, 1)
        @test reward(m, s, DOWN) == 0 && next(m, s, DOWN) == s && reward(m, s, SAMPLE) == 0
    end
    @testset "pobax: +10 on entering the last column, any start, γ 0.99" begin
        m = instance("rocksample-7x8@pobax").make()
        @test discount(m) == 0.99 && length(m.rocks) == 7 && !((7, 4) in m.rocks)
        s = RockState{7}(6, 7, fill(true, 7))
        @test reward(m, s, RIGHT) == 10 && isterminal(m, next(m, s, RIGHT))
        @test reward(m, s, UP) == 0 && next(m, s, UP) == s
        d = initialstate(m)
        @test length(support(d)) == 6 * 7 * 2^7 && sum(pdf(d, s) for s in support(d)) ≈ 1
        @test [stateindex(m, s) for s in support(d)] == 1:(6 * 7 * 2^7)
        @test length(H.visible_priors(m, d)) == 42
    end
    @testset "a sensor that errs everywhere" begin
        m = instance("rocksample-7x8@noisy").make()
        @test pdf(observation(m, check(1), RockState{8}(3, 1, fill(true, 8))), :good) ≈ 0.85
        @test m.accuracy[H.cell_index(m, 3, 3), 1] ≈ 0.5 + 0.35 * 2^(-2 / 20)
    end
end
