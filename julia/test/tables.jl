@testset "tables of $(typeof(m)) against the model's functions" for m in SMALL
    t = H.tables(m)
    V, A = H.nvisible(m), length(actions(m))
    for s in states(m), (i, a) in enumerate(actions(m))
        v = H.visible_index(m, s)
        if isterminal(m, s)
            @test t.first_row[(v - 1) * A + i] == -1 && t.terminal[v]
            continue
        end
        k = t.factor[(v - 1) * A + i] + 1
        row = t.first_row[(v - 1) * A + i] + (k == 0 ? 0 : H.factor_value(m, s, k) - 1) + 1
        @test t.legal[row] == (a in actions(m, s))
        outcomes = (t.row_outcomes[row] + 1):t.row_outcomes[row + 1]
        sp = only(support(transition(m, s, a)))
        j = only(outcomes)
        @test t.outcome_visible[j] == H.visible_index(m, sp) - 1
        @test t.outcome_probability[j] == t.outcome_cdf[j] == 1
        k == 0 || isterminal(m, sp) || @test t.outcome_value[j] == H.factor_value(m, sp, k) - 1
        @test t.outcome_reward[:, j] == [reward(shaped(m, name), s, a, sp) for name in shapings(m)]
        o = t.outcome_observation[j] + 1
        @test t.observation_probability[o, :] == [pdf(observation(m, a, sp), x) for x in observations(m)]
    end
    @test t.observation_cdf[:, end] ≈ ones(size(t.observation_cdf, 1))
    @test length(t.first_row) == V * A
end

@testset "random transitions of a generic model" begin
    m = H.harnessed(Drift())
    t = H.tables(m)
    @test t.start_cdf ≈ [0.3, 1.0]
    @test vec(t.start_values) == [0, 1]
    row = t.first_row[1] + 2                                # state 2, action go
    outcomes = (t.row_outcomes[row] + 1):t.row_outcomes[row + 1]
    @test t.outcome_value[outcomes] == [1, 2]
    @test t.outcome_cdf[outcomes] ≈ [0.4, 1.0]
    @test t.outcome_reward[1, outcomes] == [0.0, 1.0]
    @test t.terminal == [false, true]
    @test H.describe(m)["actions"] == ["go", "stay"]
end

@testset "tables of a state type $T" for T in (Union{Int,TerminalState}, Any)
    m = H.harnessed(Corridor{T}())
    t = H.tables(m)
    @test t.terminal == [false, true]
    @test isterminal(m, terminalstate) && !isterminal(m, 3)
    last_go, ended = t.first_row[1] + 3, t.first_row[1] + 4
    @test t.row_outcomes[ended + 1] - t.row_outcomes[ended] == 1
    j, e = t.row_outcomes[last_go] + 1, t.row_outcomes[ended] + 1
    @test (t.outcome_visible[j], t.outcome_value[j], t.outcome_reward[1, j]) == (1, 3, 1.0)
    @test (t.outcome_visible[e], t.outcome_value[e], t.outcome_reward[1, e]) == (1, 3, 0.0)
    @test H.describe(m)["factor_labels"] == [["1", "2", "3", "TerminalState()"]]
end

if Base.identify_package("POMDPModels") !== nothing
    @eval import POMDPModels
    @testset "POMDPModels' T-maze" begin
        maze = POMDPModels.TMaze()
        m = H.harnessed(maze)
        t = H.tables(m)
        @test length(states(m)) == 23 && t.terminal == [false, true]
        junction = t.first_row[1] + stateindex(maze, POMDPModels.TMazeState(11, :north))
        j = only((t.row_outcomes[junction] + 1):t.row_outcomes[junction + 1])
        @test (t.outcome_visible[j], t.outcome_reward[1, j]) == (1, 4.0)    # north, where the goal is
    end
end
