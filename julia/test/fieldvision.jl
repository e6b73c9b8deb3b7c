const SMALL_FIELD = FieldVision([(2, 1), (1, 2), (3, 3)]; columns = 3)

@testset "a consistent POMDP" begin
    @test has_consistent_initial_distribution(SMALL_FIELD)
    @test consistent_where_it_leads(SMALL_FIELD)
    @test length(states(SMALL_FIELD)) == 9 * 8 + 1
    @test length(observations(SMALL_FIELD)) == 8 == length(H.observation_names(SMALL_FIELD))
    @test H.action_names(SMALL_FIELD) == ["up()", "right()", "down()", "left()", "sample()"]
    @test all(a -> a <= SAMPLE, actions(SMALL_FIELD, rand(MersenneTwister(0), initialstate(SMALL_FIELD))))
end

@testset "every step reads all rocks, each by the accuracy from where it has led to" begin
    m = SMALL_FIELD
    d0 = 2 * sqrt(2) / 4
    s = RockState{3}(1, 2, [true, false, true])
    sp = rand(MersenneTwister(0), transition(m, s, RIGHT))
    @test (sp.x, sp.y) == (2, 2)
    right = [0.5 + 0.5 * 2^(-d / d0) for d in (1, 1, sqrt(2))]
    expected = Dict("$a $b $c" => prod(
        (word == "good") == good ? p : 1 - p for (word, good, p) in zip((a, b, c), s.good, right)
    ) for a in ("good", "bad"), b in ("good", "bad"), c in ("good", "bad"))
    d = observation(m, RIGHT, sp)
    for (o, name) in zip(observations(m), H.observation_names(m))
        @test pdf(d, o) ≈ expected[name]
        @test name == join((H.sensor_labels(m, j)[H.sensor_label(m, j, o)] for j in 1:3), " ")
    end
    @test H.observation_names(m)[2] == "good good bad"       # the last rock's label runs fastest
end

@testset "agrees with DiscreteUpdater over the joint state" begin
    rng = MersenneTwister(5)
    @test worst_difference(SMALL_FIELD, rng, 100, 30) < 1e-12
    @test worst_difference(instance("fieldvision-rocksample-5x5").make(), rng, 3, 15) < 1e-12
end

@testset "tables of the sensors" begin
    m = SMALL_FIELD
    t = H.tables(m)
    A = length(actions(m))
    @test size(t.observation_probability) == (1, 1)
    for v in 1:H.nvisible(m), (i, a) in enumerate(actions(m)), (j, k) in enumerate(H.sensor_factors(m))
        row = t.sensor_row[(v - 1) * A + i, j]
        if v == H.nvisible(m)
            @test row == -1
            continue
        end
        for x in 1:2
            d = H.sensor_reading(m, j, a, H.representative(m, v, k, x))
            @test t.sensor_probability[row + x, :] == [pdf(d, label) for label in 1:2]
            @test t.sensor_cdf[row + x, 1] == pdf(d, 1)
        end
    end
    @test H.describe(m)["sensors"][2] == Any["2", 1, ["good", "bad"]]
    @test !haskey(H.describe(SMALL_ROCKS), "sensors") && size(H.tables(SMALL_ROCKS).sensor_row, 2) == 0
end
