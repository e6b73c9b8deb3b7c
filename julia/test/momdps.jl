# Models of MOMDPs.jl: visible part and one hidden factor.
if Base.find_package("MOMDPs") === nothing
    @info "no models of MOMDPs.jl are tried: the package is missing"
else
    include("momdp_model.jl")

    m = H.harnessed(Doors())
    @testset "x is visible, y the hidden factor" begin
        @test H.nvisible(m) == 4 && H.factor_sizes(m) == (2,)
        @test H.visible_names(m) == ["x"] && H.visible_values(m, 2) == [2]
        @test all(s -> H.assemble(m, H.visible_index(m, s), [H.factor_value(m, s, 1)]) == s, states(m))
        @test H.belief_updater(Doors()) isa FactoredUpdater
        @test H.harnessed(Sudden()) isa H.Flat
    end
    @testset "the factored update is Bayes' rule over all states, given the next x" begin
        rng = Xoshiro(4)
        for _ in 1:200
            x, a, p = rand(rng, 1:3), rand(rng, 1:2), rand(rng)
            prior, posterior = [1 - p, p], zeros(2)
            xp, o = rand(rng, 1:4), rand(rng, 1:2)
            joint = [sum(prior[y] * pdf(transition(Doors(), (x, y), a), (xp, yp)) * pdf(observation(Doors(), a, (xp, yp)), o)
                         for y in 1:2) for yp in 1:2]
            total = H.bayes!(posterior, prior, m, x, a, xp, o, 1)
            @test total ≈ sum(joint) atol = 1e-12
            total > 0 && @test posterior ≈ joint ./ sum(joint)
        end
    end
    @testset "native SARSOP sees x; SARSOP.jl's own path finds the same value" begin
        alpha, record = H.solve_native_sarsop(m; timeout = 20)
        @test record["lower"] <= record["upper"] + 1e-6
        if Base.find_package("SARSOP") === nothing
            @info "SARSOP.jl is not tried: the package is missing"
        else
            @eval using SARSOP: SARSOP
            folder = mktempdir()
            solver = SARSOP.SARSOPSolver(;
                precision = 1e-4, timeout = 20.0, verbose = false, pomdp_filename = joinpath(folder, "model.pomdpx"),
                policy_filename = joinpath(folder, "policy.out"),
            )
            theirs = H.AlphaVectors(m, solve(solver, Doors()))
            @test H.initial_value(m, theirs) ≈ H.initial_value(m, alpha) atol = 2e-3
        end
    end
end
