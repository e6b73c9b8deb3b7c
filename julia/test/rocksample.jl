m = instance("rocksample-7x8").make()

@testset "sizes and names" begin
    @test length(states(m)) == 7 * 7 * 2^8 + 1
    @test length(actions(m)) == 13
    @test action_names(m)[[UP, RIGHT, DOWN, LEFT, SAMPLE, check(1), check(8)]] ==
          ["up()", "right()", "down()", "left()", "sample()", "check(1)", "check(8)"]
    @test observation_names(m) == ["none", "good", "bad"]
    @test discount(m) == 0.95
end

@testset "consistency of distributions (POMDPTools)" begin
    for model in (SMALL_ROCKS, RockSample(4, 3; rng = MersenneTwister(1)))
        @test has_consistent_distributions(model)
    end
    @test consistent_where_it_leads(m)
end

@testset "indices and iteration" begin
    for model in (m, SMALL_ROCKS)
        @test [stateindex(model, s) for s in states(model)] == 1:length(states(model))
        @test [actionindex(model, a) for a in actions(model)] == 1:length(actions(model))
        @test [obsindex(model, o) for o in observations(model)] == 1:3
    end
    @test_throws BoundsError states(m)[length(states(m)) + 1]
end

good = RockState{8}(1, 4, fill(true, 8))
at(x, y, s = good) = RockState{8}(x, y, s.good)

@testset "moves" begin
    next(s, a) = only(support(transition(m, s, a)))
    @test next(good, UP) == at(1, 5)
    @test next(good, RIGHT) == at(2, 4)
    @test next(good, DOWN) == at(1, 3)
    @test next(good, LEFT) == good              # off the grid: stays
    @test reward(m, good, LEFT) == -100
    @test reward(m, good, RIGHT) == 0
    @test isterminal(m, next(at(7, 2), RIGHT))
    @test reward(m, at(7, 2), RIGHT) == 10
    @test reward(m, at(3, 7), UP) == -100
    @test reward(m, at(3, 1), DOWN) == -100
    out = next(at(7, 2), RIGHT)
    @test next(out, UP) == out
    @test reward(m, out, UP) == 0 && reward(m, out, SAMPLE) == 0
    @test actions(m, at(1, 7)) == setdiff(1:13, [UP, LEFT])
    @test actions(m, at(7, 1)) == setdiff(1:13, [DOWN])      # right is the exit
    @test isempty(actions(m, out))
end

@testset "rocks" begin
    cells = [(3, 1), (1, 2), (4, 2), (7, 4), (3, 5), (4, 5), (6, 6), (2, 7)]
    for (i, (x, y)) in enumerate(cells)
        s = at(x, y)
        sp = only(support(transition(m, s, SAMPLE)))
        @test reward(m, s, SAMPLE) == 10
        @test sp.good == [j != i for j in 1:8]
        @test reward(m, sp, SAMPLE) == -10
        @test only(support(transition(m, sp, SAMPLE))) == sp
    end
    @test reward(m, at(5, 5), SAMPLE) == 0
    @test only(support(transition(m, at(5, 5), SAMPLE))) == at(5, 5)
end

@testset "sensor" begin
    for i in 1:8, (x, y) in ((1, 1), (4, 4), (7, 7))
        d = sqrt((x - m.rocks[i][1])^2 + (y - m.rocks[i][2])^2)
        right = 0.5 + 0.5 * 2^(-d / 20)
        s = at(x, y)
        bad = RockState{8}(x, y, zero(s.good))
        @test pdf(observation(m, check(i), s), :good) ≈ right
        @test pdf(observation(m, check(i), s), :bad) ≈ 1 - right
        @test pdf(observation(m, check(i), bad), :bad) ≈ right
        @test reward(m, s, check(i)) == 0
    end
    @test pdf(observation(m, check(1), at(3, 1)), :good) == 1      # on the rock the reading is sure
    @test pdf(observation(m, UP, good), :none) == 1
    @test initialobs(m, good) == Deterministic(:none)
end

@testset "start" begin
    d = initialstate(m)
    @test length(support(d)) == 256
    @test sum(pdf(d, s) for s in support(d)) ≈ 1
    @test all(s -> (s.x, s.y) == (1, 4), support(d))
    @test pdf(d, at(2, 4)) == 0
    rng = MersenneTwister(0)
    draws = [rand(rng, d) for _ in 1:10_000]
    @test all(abs(count(s -> s.good[i], draws) / 10_000 - 0.5) < 5 * 0.005 for i in 1:8)
end

@testset "parameters" begin
    odd = RockSample([(1, 1)]; columns = 2, rows = 3, good_probability = 0.25, good_reward = 3, bad_reward = -4,
        exit_reward = 5, illegal_move_penalty = 0, half_efficiency_distance = 1, discount = 0.9, start = (2, 3))
    @test has_consistent_distributions(odd)
    @test discount(odd) == 0.9
    s = RockState{1}(1, 1, [true])
    @test reward(odd, s, SAMPLE) == 3
    @test reward(odd, RockState{1}(1, 1, [false]), SAMPLE) == -4
    @test reward(odd, RockState{1}(2, 1, [true]), RIGHT) == 5
    @test reward(odd, s, LEFT) == 0
    @test pdf(observation(odd, check(1), RockState{1}(2, 1, [true])), :good) ≈ 0.75      # d = d0: η = 1/2
    @test pdf(initialstate(odd), RockState{1}(2, 3, [true])) == 0.25
    @test_throws ArgumentError RockSample([(8, 1)]; columns = 7)
    @test_throws ArgumentError RockSample([(1, 1), (1, 1)])
    @test_throws ArgumentError RockSample([(1, 1)]; start = (0, 0))
    @test_throws ArgumentError RockSample([(1, 1)]; starts = [(1, 1), (1, 1)])
    @test_throws ArgumentError RockSample([(1, 1)]; best_accuracy = 0.4)
    harsh = RockSample([(1, 1)]; columns = 2, starts = [(2, 1), (1, 2)], empty_sample_penalty = -7, illegal_ends = true)
    @test has_consistent_distributions(harsh)
    @test isterminal(harsh, only(support(transition(harsh, RockState{1}(2, 2, [true]), SAMPLE))))
    @test reward(harsh, RockState{1}(2, 2, [true]), SAMPLE) == -7
    @test [(s.x, s.y) for s in support(initialstate(harsh))] == [(2, 1), (2, 1), (1, 2), (1, 2)]
    @test Set((s.x, s.y) for s in rand(MersenneTwister(0), initialstate(harsh), 100)) == Set([(2, 1), (1, 2)])
end

@testset "type stability and allocation" begin
    s = good
    @test @inferred(transition(m, s, UP)) isa Deterministic
    @inferred observation(m, check(1), s)
    @inferred reward(m, s, SAMPLE)
    @inferred stateindex(m, s)
    step(m, s) = (a = check(3); sp = transition(m, s, a).val; pdf(observation(m, a, sp), :good) + reward(m, s, a))
    step(m, s)
    @test @allocated(step(m, s)) <= 16      # the boxed result
end
