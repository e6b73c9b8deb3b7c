"Value of always playing `a` from `s`, by following the (deterministic) model."
function repeated(m, s, a, n)
    total, weight = 0.0, 1.0
    for _ in 1:n
        total += weight * reward(m, s, a)
        weight *= discount(m)
        s = only(support(transition(m, s, a)))
    end
    return total
end

@testset "QMDP on Tiger: closed form" begin
    # After the first step the tiger's place is known: opening the right door pays 10 for ever.
    alpha, _ = H.solve_qmdp(H.harnessed(Tiger()))
    tiger = Tiger()
    forever = 10 / (1 - discount(tiger))
    @test maximum(alpha.values) ≈ forever rtol = 1e-6
    listen = -1 + discount(tiger) * forever
    @test any(i -> all(isapprox.(alpha.values[i, :], listen; rtol = 1e-6)), axes(alpha.values, 1))
end

@testset "two rocks by hand" begin
    # One row of three cells, rocks on the first two, start on the first: fully observed values by hand.
    m = RockSample([(1, 1), (2, 1)]; columns = 3, rows = 1, start = (1, 1))
    γ = discount(m)
    value(first, second) = begin
        t, total = 0, 0.0
        first && (total += 10γ^t; t += 1)
        t += 1
        second && (total += 10γ^t; t += 1)
        t += 1
        total + 10γ^t
    end
    @test H.mdp_bound(m).discounted ≈ sum(value(a, b) for a in (true, false), b in (true, false)) / 4 atol = 1e-8
    @test H.mdp_bound(m).undiscounted ≈ 20
    @test H.mdp_bound(m; horizon = 2).undiscounted ≈ 0.5 * 10 + 0.25 * 10    # the first if it is good, else the second; no exit yet
end

@testset "MDP bound on RockSample(7, 8): every good rock and the exit" begin
    @test H.mdp_bound(instance("rocksample-7x8").make()).undiscounted == 50
end

@testset "pruning keeps the upper surface" begin
    kept = H.undominated([(1, 1, [1.0, 0.0]), (1, 2, [0.0, 1.0]), (1, 3, [0.0, 0.5]), (1, 4, [1.0, 0.0])])
    @test [k[2] for k in kept] == [1, 2]
end

@testset "SARSOP on the factored file, $(typeof(m))" for m in SMALL
    alpha, record = H.solve_sarsop(m; timeout = 20)
    @test record["lower"] <= record["upper"] + 1e-3
    @test H.initial_value(m, alpha) ≈ record["lower"] atol = 2e-3      # the file rounds to six digits
    @test record["upper"] <= H.mdp_bound(m).discounted + 1e-3
    qmdp, _ = H.solve_qmdp(m)
    @test record["lower"] <= H.initial_value(m, qmdp) + 1e-3
    native, native_record = H.solve_native_sarsop(m; timeout = 20)
    @test native_record["lower"] <= native_record["upper"] + 1e-6
    # Two solvers, two descriptions of the model, one value.
    @test native_record["lower"] <= record["upper"] + 1e-3
    @test record["lower"] <= native_record["upper"] + 1e-3
end

@testset "what POMDPX cannot say is refused" begin
    # Where Drift goes and whether it ends is one random event.
    @test_throws ArgumentError H.write_pomdpx(IOBuffer(), H.harnessed(Drift()))
end
