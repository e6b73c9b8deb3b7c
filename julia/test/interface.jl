# What the harness interface promises, by brute force over all states.
@testset "$(typeof(m))" for m in SMALL
    V, sizes = H.nvisible(m), H.factor_sizes(m)
    @testset "states are visible parts times factor values" begin
        for s in states(m)
            v = H.visible_index(m, s)
            values = [H.factor_value(m, s, k) for k in eachindex(sizes)]
            @test H.assemble(m, v, values) == s
            @test isterminal(m, s) == (v == V)
            isterminal(m, s) || @test H.joint_values(m, H.joint_index(m, s)) == values
        end
        @test length(states(m)) == (V - 1) * prod(sizes; init = 1) + 1
    end
    @testset "only the relevant factor matters and changes" begin
        for s in states(m), a in actions(m)
            isterminal(m, s) && continue
            v = H.visible_index(m, s)
            k = H.relevant_factor(m, v, a)
            r = H.representative(m, v, k, k == 0 ? 1 : H.factor_value(m, s, k))
            sp, rp = only(support(transition(m, s, a))), only(support(transition(m, r, a)))
            @test H.visible_index(m, sp) == H.visible_index(m, rp)
            @test reward(m, s, a) == reward(m, r, a)
            @test (a in actions(m, s)) == (a in actions(m, r))
            @test all(pdf(observation(m, a, sp), o) == pdf(observation(m, a, rp), o) for o in observations(m))
            isterminal(m, sp) && continue
            @test all(H.factor_value(m, sp, j) == H.factor_value(m, s, j) for j in eachindex(sizes) if j != k)
            k == 0 || @test H.factor_value(m, sp, k) == H.factor_value(m, rp, k)
        end
    end
    @testset "names" begin
        @test length(action_names(m)) == length(actions(m)) && allunique(action_names(m))
        @test length(observation_names(m)) == length(observations(m))
        @test all(length(H.factor_labels(m, k)) == sizes[k] for k in eachindex(sizes))
        @test all(length(H.visible_values(m, v)) == length(H.visible_names(m)) for v in 1:V)
    end
end
