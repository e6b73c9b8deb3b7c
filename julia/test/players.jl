# Policies of users' files: what they are given, what is copied, and what their errors say.

"A planner with a generator and a memory of its own, which only samples from its belief."
mutable struct Sampling{R<:AbstractRNG} <: Policy
    rng::R
    calls::Int
    seen::Vector{Any}
end
function POMDPs.action(p::Sampling, b)
    p.calls += 1
    push!(p.seen, rand(p.rng, b))
    return rand(p.rng, 1:5) + (rand() < 0.5 ? 0 : 1)
end
struct SamplingSolver <: Solver
    depth::Int
end
POMDPs.solve(::SamplingSolver, m::POMDP) = Sampling(Xoshiro(1), 0, Any[])

"Uniform numbers that do not depend on how many there are."
numbers(t, E) = [rand(Xoshiro(1000t + e)) for e in 1:E]

function buffers_of(m, E; seed = 0)
    b = (u = numbers(seed, E), actions = zeros(Int32, E), rewards = zeros(E), visible = zeros(Int32, E),
        observation = zeros(Int32, E), done = fill(false, E), marginals = zeros(E, H.nmarginals(m)), numbers = zeros(E))
    simulator = H.Simulator(m, Base.structdiff(b, (; numbers = 0)))
    H.reset!(simulator)
    return b, simulator
end

"All actions of E episodes over n steps."
function actions_of(planned, E, n)
    b, simulator = buffers_of(planned.model, E)
    players = H.Players(planned, b)
    return stack(1:n) do t
        b.numbers .= numbers(100 + t, E)
        H.act!(players, Returns(nothing))
        b.u .= numbers(200 + t, E)
        H.step!(simulator)
        copy(b.actions)
    end, players
end

@testset "episodes have their own copies and random numbers" begin
    m = instance("rocksample-15x15").make()
    planned = H.planned(SamplingSolver(3), m, "sampling.jl")
    all_actions, players = actions_of(planned, 12, 4)
    few, _ = actions_of(planned, 5, 4)
    @test few == all_actions[1:5, :]
    @test length(unique(eachrow(all_actions))) > 6
    @test planned.policy.calls == 0
    @test all(one -> one.policy.calls == 4 && all(s -> s isa RockState, one.policy.seen), players.players)
    @test occursin("SamplingSolver(depth=3)", planned.about)
end

mean_of(f, d, n) = (rng = Xoshiro(3); count(_ -> f(rand(rng, d)), 1:n) / n)

@testset "a belief over 2^15 hidden states is sampled without listing them" begin
    m = instance("rocksample-15x15").make()
    belief = initialize_belief(FactoredUpdater(m), initialstate(m))
    rand(Xoshiro(0), belief)
    @test (@allocated rand(Xoshiro(0), belief)) < 20_000
    @test eltype(belief) == statetype(m)
    frequency = [mean_of(s -> H.factor_value(m, s, k) == 2, belief, 4000) for k in 1:15]
    @test all(f -> abs(f - 0.5) < 4 * 0.5 / sqrt(4000), frequency)
end
@testset "copies share the model and nothing else" begin
    m = BorderCross()
    inner = Dict(:a => [1, 2])
    kept = IdDict{Any,Any}()
    H.each_object(x -> kept[x] = x, m)
    (model, dict) = H.own_copy((m, inner), kept)
    @test model.readings === m.readings && dict == inner && dict !== inner
    @test length(H.generators((Xoshiro(1), [MersenneTwister(2)], m))) == 2
end

@testset "alpha vectors are given the exact belief of a flat model" begin
    m = H.harnessed(Tiger())
    policy = solve(H.QMDPSolver(; max_iterations = 100), Tiger())
    planned = H.planned(policy, m, "qmdp.jl")
    @test planned.updater === nothing
    b, _ = buffers_of(m, 3)
    players = H.Players(planned, b)
    b.marginals .= [0.5 0.5; 0.99 0.01; 0.01 0.99]
    H.act!(players, Returns(nothing))
    @test b.actions == [actionindex(Tiger(), action(policy, DiscreteBelief(Tiger(), collect(row)))) - 1 for row in eachrow(b.marginals)]
end

@testset "all are served, and the first error ends it" begin
    served = zeros(Int, 1000)
    H.share_out(i -> served[i] += 1, 1000, Returns(nothing))
    @test all(==(1), served)
    @test_throws ErrorException("seven") H.share_out(i -> i == 7 && error("seven"), 1000, Returns(nothing))
    @test_throws InterruptException H.share_out(i -> sleep(0.001), 1000, () -> throw(InterruptException()))
end

@testset "errors name file and line" begin
    write_file(text) = (file = joinpath(mktempdir(), "wrong.jl"); write(file, text); file)
    failing(text) = try
        H.run_file(Module(), write_file(text))
    catch error
        sprint(showerror, error)
    end
    @test occursin(r"wrong\.jl, line 2: UndefVarError", failing("1\nno_such_thing\n"))
    @test occursin(r"wrong\.jl, line 1: Julia package NoSuchPackage is not installed: julia", failing("using NoSuchPackage"))
    @test H.run_file(Module(), write_file("1 + 1")) == 2
    @test_throws r"it must end in a Policy" H.planned(3, SMALL_ROCKS, "three.jl")
    @test_throws r"neither alpha vectors nor" H.solve_file(H.planned(RandomPolicy(SMALL_ROCKS), SMALL_ROCKS, "random.jl"))
end
