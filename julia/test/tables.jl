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
