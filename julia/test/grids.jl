# Tag, the grids of Littman, Cassandra and Kaelbling, heaven or hell, and Tiger, against what their files say in words.
probabilities(d, index) = Dict(index(v) => p for (v, p) in weighted_iterator(d) if p > 0)

@testset "maps" begin
    g = H.GridMap(["* ", "**"])
    @test g.places == [(1, 1), (1, 2), (2, 2)]
    @test [H.neighbour(g, 1, d) for d in 1:4] == [0, 0, 2, 0]
    @test [H.neighbour(g, 2, d) for d in 1:4] == [1, 3, 0, 0]
    @test H.layout(instance("tag").make())["walls"][1] == [1, 1]
end

@testset "Tag" begin
    m = instance("tag").make()
    cell(x, y) = m.map.number[y, x]
    @test H.ncells(m.map) == 29 && length(states(m)) == 29^2 + 1
    @test has_consistent_distributions(m)
    flee(robot, opponent) = Dict(m.map.places[o] => p for (o, p) in m.fleeing[cell(robot...), cell(opponent...)])
    # Entries of TagAvoid.pomdpx: v4 is the lowest row, h0 the first column.
    @test flee((1, 5), (1, 5)) == Dict((1, 5) => 0.6, (1, 4) => 0.2, (2, 5) => 0.2)
    @test flee((1, 5), (2, 5)) == Dict((2, 5) => 0.4, (2, 4) => 0.2, (3, 5) => 0.4)
    @test flee((1, 5), (10, 5)) == Dict((10, 5) => 0.8, (10, 4) => 0.2)
    @test flee((1, 5), (1, 4)) == Dict((1, 4) => 0.8, (2, 4) => 0.2)
    @test flee((1, 5), (6, 4)) == Dict((6, 4) => 0.2, (6, 3) => 0.4, (7, 4) => 0.4)
    here, there = H.TagState(cell(6, 4), cell(6, 4)), H.TagState(cell(6, 4), cell(6, 3))
    @test reward(m, here, H.TAG) == 10 && isterminal(m, only(support(transition(m, here, H.TAG))))
    @test reward(m, there, H.TAG) == -10 && reward(m, there, UP) == -1
    @test all(sp -> sp.robot == cell(6, 3), support(transition(m, there, UP)))
    @test transition(m, there, H.TAG).vals == [there]
    @test only(support(observation(m, UP, here))) == 2 && only(support(observation(m, UP, there))) == 1
    @test length(support(initialstate(m))) == 29^2
    @testset "the opponent is all that hides" for s in states(m), a in actions(m)
        v = H.visible_index(m, s)
        @test H.assemble(m, v, (H.factor_value(m, s, 1),)) == s
        isterminal(m, s) && continue
        @test allunique(stateindex(m, sp) for sp in support(transition(m, s, a)))
        @test issorted(stateindex(m, sp) for sp in support(transition(m, s, a)))
    end
end

@testset "grids without a compass: $name" for (name, cells, readings) in
                                              (("tiger-grid", 9, 17), ("hallway", 15, 21), ("hallway2", 23, 17))
    m = instance(name).make().model
    @test length(states(m)) == 4cells && length(observations(m)) == readings
    @test has_consistent_distributions(m)
    for s in states(m)
        @test probabilities(transition(m, s, H.STAY), identity) ==
              (H.cell_of(s) in H.marked(m.map, "+") ? probabilities(initialstate(m), identity) : Dict(s => 1.0))
    end
end

@testset "Hallway in numbers of its file" begin
    m = instance("hallway").make().model
    move(s, a) = probabilities(transition(m, s + 1, a), s -> s - 1)
    @test move(3, H.FORWARD) == Dict(3 => 0.95, 5 => 0.025, 7 => 0.025)
    @test move(8, H.FORWARD) == Dict(7 => 0.05, 8 => 0.85, 13 => 0.05, 44 => 0.025, 46 => 0.025)
    @test move(1, H.TURN_RIGHT) == Dict(0 => 0.1, 1 => 0.1, 2 => 0.7, 3 => 0.1)
    @test move(3, H.TURN_AROUND) == Dict(0 => 0.15, 1 => 0.6, 2 => 0.15, 3 => 0.1)
    @test pdf(observation(m, 1, 1), 12) ≈ 0.692550 atol = 1e-6       # front, back and left
    @test pdf(observation(m, 1, 11), 17) == 1                       # the first landmark, facing down
    @test reward(m, 33, H.FORWARD, 57) == 1 && reward(m, 33, H.FORWARD, 34) == 0
    @test length(support(initialstate(m))) == 56
    grid = instance("tiger-grid").make().model
    @test support(initialstate(grid)) == [25, 29]
    @test reward(grid, 5, H.FORWARD, 1) == -1 && reward(grid, 5, H.FORWARD, 9) == 1
end

@testset "heaven or hell" begin
    m = instance("heaven-hell").make()
    @test has_consistent_distributions(m) && length(states(m)) == 20
    @test has_consistent_distributions(H.HeavenHell(; accuracy = 0.8))
    walk(s, moves) = foldl((s, a) -> only(support(transition(m, s, a))), moves; init = s)
    s = H.HeavenState(m.start, true)
    @test walk(s, [DOWN, RIGHT, RIGHT]).cell == m.priest
    @test only(k for (k, p) in probabilities(observation(m, UP, walk(s, [DOWN, RIGHT, RIGHT])), identity)) == 3
    heaven = walk(s, [UP, UP, RIGHT, RIGHT])
    @test reward(m, heaven, UP) == 1 && reward(m, walk(s, [UP, UP, LEFT, LEFT]), UP) == -1
    @test probabilities(transition(m, heaven, UP), identity) == probabilities(initialstate(m), identity)
    # Eleven steps a round by way of the priest, with a reward at the last of them; the observed value needs five.
    @test H.mdp_bound(m).discounted ≈ 0.99^4 / (1 - 0.99^5)
end

@testset "Tiger, two ways" begin
    ours, theirs = H.tables(H.Flat(H.Tiger())), H.tables(H.harnessed(Tiger()))
    @test all(getfield(ours, name) ≈ getfield(theirs, name) for name in fieldnames(typeof(ours)))
end
