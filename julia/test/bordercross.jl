m = instance("bordercross-7x8").make()
hidden = instance("bordercross-7x8-random").make()
next(model, s, a) = only(support(transition(model, s, a)))
named(model, name) = findfirst(==(name), action_names(model))

@testset "sizes and names" begin
    @test length(states(m)) == (7 * 6)^2 + 1
    @test length(actions(m)) == 9
    @test action_names(m) == ["up(1)", "right(1)", "down(1)", "left(1)", "up(2)", "right(2)", "down(2)", "left(2)", "cooperate()"]
    @test observation_names(m) == string.(0:9)
    @test [stateindex(m, s) for s in states(m)] == 1:length(states(m))
end

@testset "consistency of distributions (POMDPTools)" begin
    for model in (SMALL_BORDER, SMALL_HIDDEN)
        @test has_consistent_distributions(model)
    end
    @test consistent_where_it_leads(m)
    @test consistent_where_it_leads(hidden)
end

@testset "moves" begin
    s = BorderState(4, 1, 7, 3)
    @test only(support(initialstate(m))) == s
    @test next(m, s, named(m, "up(1)")) == BorderState(3, 1, 7, 3)
    @test next(m, s, named(m, "right(1)")) == BorderState(4, 2, 7, 3)
    @test next(m, s, named(m, "down(1)")) == BorderState(5, 1, 7, 3)
    @test next(m, s, named(m, "left(1)")) == s && reward(m, s, named(m, "left(1)")) == -100
    @test next(m, s, named(m, "up(2)")) == BorderState(4, 1, 6, 3)
    @test next(m, s, named(m, "right(2)")) == BorderState(4, 1, 7, 4)
    @test next(m, s, named(m, "down(2)")) == s && reward(m, s, named(m, "down(2)")) == -100
    @test next(m, s, named(m, "left(2)")) == BorderState(4, 1, 7, 2)
    wall = BorderState(4, 6, 4, 5)
    @test next(m, wall, named(m, "right(1)")) == wall && reward(m, wall, named(m, "right(1)")) == -100
    @test !(named(m, "right(1)") in actions(m, wall)) && named(m, "right(2)") in actions(m, wall)
end

@testset "crossing" begin
    ready, apart, early = BorderState(2, 6, 2, 6), BorderState(2, 6, 3, 6), BorderState(2, 5, 2, 5)
    @test isterminal(m, next(m, ready, COOPERATE)) && reward(m, ready, COOPERATE) == 500
    for s in (apart, early)
        @test next(m, s, COOPERATE) == s && reward(m, s, COOPERATE) == 0
    end
    crossed = next(m, ready, COOPERATE)
    @test all(a -> next(m, crossed, a) == crossed && reward(m, crossed, a) == 0, actions(m))
end

@testset "the best plan has 12 steps" begin
    s, discounted, weight = only(support(initialstate(m))), 0.0, 1.0
    plan = [fill("right(1)", 5); fill("down(1)", 3); fill("right(2)", 3); "cooperate()"]
    for name in plan
        a = named(m, name)
        discounted += weight * reward(m, s, a)
        weight *= discount(m)
        s = next(m, s, a)
    end
    @test isterminal(m, s)
    @test H.moves_needed(m, only(support(initialstate(m)))) == 11
    bound = H.mdp_bound(m)
    @test bound.undiscounted == 500
    @test bound.discounted ≈ discounted atol = 1e-6
    @test discounted ≈ 500 * 0.95^11
end

@testset "readings against simulated noise" begin
    rng = MersenneTwister(3)
    for (dr, dc) in ((0, 0), (0, 1), (2, 1), (3, 2), (6, 5))
        d = hypot(dr, dc)
        σ = 1 - 2.0^(-d / 20)
        n = 200_000
        counts = zeros(10)
        for _ in 1:n
            counts[min(round(Int, d + abs(σ * randn(rng))), 9) + 1] += 1
        end
        p = H.reading_probabilities(d, 20.0, 1.0, 9)
        @test sum(p) ≈ 1
        @test all(abs.(counts ./ n .- p) .<= 5 .* sqrt.(p .* (1 .- p) ./ n) .+ 1e-9)
    end
    @test H.reading_probabilities(0.0, 20.0, 1.0, 9)[1] == 1
    @test H.reading_probabilities(3.0, 20.0, 0.0, 9)[4] == 1            # without noise the rounded distance
    @test H.reading_probabilities(50.0, 20.0, 1.0, 9)[10] == 1          # capped
end

@testset "hidden start" begin
    d = initialstate(hidden)
    @test length(support(d)) == 21
    @test all(s -> (s.row1, s.column1) == (4, 1) && s.column2 <= 3, support(d))
    @test H.visible_index(hidden, BorderState(4, 1, 1, 1)) == H.visible_index(hidden, BorderState(4, 1, 7, 6))
end

@testset "shaping" begin
    paper, potential = shaped(m, "paper"), shaped(m, "potential")
    @test shapings(m) == ["none", "paper", "potential"]
    @test_throws ArgumentError shaped(m, "other")
    together = BorderState(3, 4, 3, 4)
    @test reward(paper, together, COOPERATE) == 1                                   # share a cell
    @test reward(paper, BorderState(3, 6, 3, 6), named(m, "up(1)")) == 1            # acting robot at the wall, apart
    @test reward(paper, BorderState(3, 6, 2, 6), named(m, "up(1)")) == 2            # both
    @test reward(paper, BorderState(3, 6, 5, 2), named(m, "up(2)")) == 0            # the other robot is at the wall
    @test reward(paper, BorderState(3, 6, 5, 2), COOPERATE) == 1                    # either, for cooperate
    @test reward(paper, BorderState(3, 6, 3, 6), COOPERATE) == 500                  # the end is not shaped
    @test reward(paper, BorderState(4, 6, 1, 1), named(m, "right(1)")) == -99       # stays at the wall
    # Potential shaping telescopes: over an episode it adds Φ(end) − Φ(start), undiscounted, whatever was done; waiting pays nothing.
    rng = MersenneTwister(5)
    for _ in 1:20
        s, extra = rand(rng, states(m)[1:end-1]), 0.0
        first = H.moves_needed(m, s)
        for _ in 1:30
            isterminal(m, s) && break
            a = rand(rng, actions(m))
            extra += reward(potential, s, a) - reward(m, s, a)
            s = next(m, s, a)
        end
        last = isterminal(m, s) ? 0 : H.moves_needed(m, s)
        @test extra == first - last
    end
    @test all(s -> reward(potential, s, COOPERATE) == 0, (s for s in states(m) if !H.can_cross(m, s)))
    @test reward(potential, BorderState(3, 6, 3, 6), COOPERATE) == 500             # nothing is left to do, before and after
    # The best plan is twelve steps, each of its eleven moves paid 1; without discount nothing else is worth more.
    @test H.mdp_bound(potential).undiscounted == 500 + 11
    @test H.mdp_bound(potential).discounted ≈ 500 * 0.95^11 + (1 - 0.95^11) / 0.05 atol = 1e-6
end

@testset "parameters" begin
    @test_throws ArgumentError BorderCross(; columns = 2)
    @test_throws ArgumentError BorderCross(; start1 = (9, 1))
    @test_throws ArgumentError BorderCross(; start2 = Tuple{Int,Int}[])
    @test_throws ArgumentError BorderCross(; shaping = "other")
    @test reward(BorderCross(; crossing_reward = 7), BorderState(1, 6, 1, 6), COOPERATE) == 7
end
