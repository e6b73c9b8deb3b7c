team = instance("dec-bordercross-7x8").make()
team_hidden = instance("dec-bordercross-7x8-random").make()
local_names = ["up()", "right()", "down()", "left()", "cooperate()"]
joint(first, second) = 5 * (findfirst(==("$first()"), local_names) - 1) + findfirst(==("$second()"), local_names)
after(m, s, a) = only(support(transition(m, s, a)))

@testset "sizes and names" begin
    @test length(actions(team)) == 25 && length(observations(team)) == 100
    @test action_names(team)[joint("up", "right")] == "up-right()"
    @test action_names(team)[25] == "cooperate-cooperate()"
    @test allunique(action_names(team)) && allunique(observation_names(team))
    @test observation_names(team)[3 * 10 + 4 + 1] == "3 4"
    described = H.describe(team)["agents"]
    @test described == [Any["robot $r", local_names, string.(0:9)] for r in 1:2]
    @test !haskey(H.describe(BorderCross()), "agents")
end

@testset "consistency of distributions (POMDPTools)" begin
    @test has_consistent_distributions(SMALL_DEC)
    @test consistent_where_it_leads(SMALL_DEC_HIDDEN)
end

# The rules once more, robot by robot.
function moved(cell, action)
    step = Dict("up" => (-1, 0), "right" => (0, 1), "down" => (1, 0), "left" => (0, -1), "cooperate" => (0, 0))[action]
    to = cell .+ step
    return 1 <= to[1] <= 7 && 1 <= to[2] <= 6 ? (to, 0) : (cell, -100)
end

@testset "each robot moves by itself" begin
    rng = MersenneTwister(2)
    words = ["up", "right", "down", "left", "cooperate"]
    for m in (team, team_hidden), _ in 1:2000
        s = rand(rng, states(m)[1:end-1])
        first, second = rand(rng, words), rand(rng, words)
        a = joint(first, second)
        cell1, paid1 = moved((s.row1, s.column1), first)
        cell2, paid2 = moved((s.row2, s.column2), second)
        if first == second == "cooperate" && cell1 == cell2 && cell1[2] == 6
            @test isterminal(m, after(m, s, a)) && reward(m, s, a) == 500
        else
            @test after(m, s, a) == BorderState(cell1..., cell2...) && reward(m, s, a) == paid1 + paid2
        end
        @test (a in actions(m, s)) == (paid1 + paid2 == 0)
    end
end

@testset "crossing takes two" begin
    ready = BorderState(2, 6, 2, 6)
    crossed = after(team, ready, joint("cooperate", "cooperate"))
    @test isterminal(team, crossed) && reward(team, ready, joint("cooperate", "cooperate")) == 500
    @test after(team, ready, joint("cooperate", "down")) == BorderState(2, 6, 3, 6)
    @test reward(team, ready, joint("cooperate", "down")) == 0 && reward(team, ready, joint("right", "right")) == -200
    @test all(a -> after(team, crossed, a) == crossed && reward(team, crossed, a) == 0, actions(team))
end

@testset "each robot reads with noise of its own" begin
    for s in (BorderState(4, 1, 7, 3), BorderState(1, 6, 7, 1), BorderState(2, 2, 2, 2))
        alone = observation(team.base, COOPERATE, s)
        both = observation(team, 25, s)
        @test all(pdf(both, 10i + j + 1) ≈ pdf(alone, i) * pdf(alone, j) for i in 0:9, j in 0:9)
    end
end

@testset "the best plan has 7 steps" begin
    # Breadth first over both robots' cells, by the rules above: nothing is hidden from one controller of both.
    words = ["up", "right", "down", "left", "cooperate"]
    layer, seen, steps = Set([((4, 1), (7, 3))]), Set([((4, 1), (7, 3))]), 0
    while !any(((one, two),) -> one == two && one[2] == 6, layer)
        steps += 1
        layer = setdiff(Set((moved(one, a)[1], moved(two, b)[1]) for (one, two) in layer for a in words for b in words), seen)
        union!(seen, layer)
    end
    @test steps == 6
    bound = H.mdp_bound(team)
    @test bound.undiscounted == 500
    @test bound.discounted ≈ 500 * 0.95^steps atol = 1e-6
end

@testset "shaping" begin
    shaped_team = shaped(team, "potential")
    @test shapings(team) == ["none", "potential"]
    @test_throws ArgumentError shaped(team, "paper")
    @test_throws ArgumentError DecBorderCross(; shaping = "paper")
    s = BorderState(4, 1, 7, 3)
    @test reward(shaped_team, s, joint("right", "right")) == 2          # two moves fewer are needed
    @test reward(shaped_team, s, joint("down", "cooperate")) == 1
    @test reward(shaped_team, s, joint("left", "cooperate")) == -100
    @test H.mdp_bound(shaped_team).undiscounted == 500 + 11             # it telescopes over the eleven moves
end

@testset "beliefs agree with DiscreteUpdater" begin
    @test worst_difference(SMALL_DEC_HIDDEN, MersenneTwister(7), 100, 15) < 1e-12
end
