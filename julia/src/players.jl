# Policies and solvers of POMDPs.jl as rows of a table: every episode has its own copy, belief and random numbers.

"""
    Planned

A policy for the harnessed model `model`, as a user's `file` gave it, ready to play.

- `updater(policy)` makes the updater of an episode, `nothing` where the policy is to have the exact belief.
- `about` says what it is: packages with their versions, solver and settings.
"""
struct Planned
    policy::Policy
    updater::Any
    model::POMDP
    file::String
    about::String
end

"""
    planned(value, m, file)

What the last expression of a user's `file` stands for on the harnessed model `m`: a `Policy`; a `Solver`, which is
solved for the model (an online one becomes a planner); or a function from the model to one of them. A pair
`what => updater` names a function from the model to the `Updater` that keeps the policy's belief, such as
[`belief_updater`](@ref) for the exact one. Without it that is the policy's own `updater(policy)`, as in the simulators of
POMDPs.jl.

Throws an `ArgumentError` that names the file, and the line where something in it fails.
"""
planned(value, m::POMDP, file) = in_file(file) do
    given, updater = value isa Union{Pair,Tuple{Any,Any}} ? value : (value, nothing)  # a pair comes from Python as a tuple
    given = given isa Union{Function,Type} ? given(original(m)) : given
    policy = policy_of(given, original(m))
    return Planned(policy, updater_of(updater, policy, original(m)), m, file, describe_origin(given, policy))
end

policy_of(policy::Policy, m) = policy
policy_of(solver::Solver, m) = solve(solver, m)
policy_of(other, m) =
    throw(ArgumentError("it must end in a Policy, a Solver or a function from the model to one, not in a $(typeof(other))"))

"The model as its author wrote it, which solvers and policies are given."
original(m::POMDP) = m
original(f::Wrapped) = f.model

updater_of(given, policy, m) = is_exact(given(m)) ? nothing : _ -> given(m)
updater_of(::Nothing, policy, m) = applicable(updater, policy) && !is_exact(updater(policy)) ? updater : nothing

"Whether an updater keeps the exact belief, which the engine has already."
is_exact(::Updater) = false
is_exact(::Union{DiscreteUpdater,FactoredUpdater}) = true

"Policies that remember and draw nothing: all episodes share one."
is_shared(::Policy) = false
is_shared(::Union{AlphaVectorPolicy,VectorPolicy,ValuePolicy}) = true

"Policies that are quick to decide; all others are taken to plan."
is_quick(policy::Policy) = is_shared(policy)
is_quick(::Union{RandomPolicy,FunctionPolicy,StochasticPolicy}) = true

"""
    solve_file(p)

The alpha vectors of a [`Planned`](@ref) policy, and what to record with them.

Throws an `ArgumentError` for a policy that has none.
"""
solve_file(p::Planned) = in_file(p.file) do
    return AlphaVectors(p.model, p.policy), Dict{String,Any}("solver" => p.about)
end

# --- what a row says of its origin ---

function describe_origin(given, policy)
    origin = given isa Solver ? settings(given) : settings(policy)
    return "$(package(given isa Solver ? given : policy)), $origin"
end

function package(x)
    home = Base.moduleroot(parentmodule(typeof(x)))
    version = pkgversion(home)
    return version === nothing ? "own code" : "$(nameof(home)) $version"
end

"Type of `x` with those of its fields that are settings: numbers, texts and symbols."
function settings(x)
    fields = [f => getfield(x, f) for f in fieldnames(typeof(x)) if isdefined(x, f)]
    plain = ["$f=$v" for (f, v) in fields if v isa Union{Real,Symbol,AbstractString}]
    return "$(nameof(typeof(x)))($(join(plain, ", ")))"
end

# --- copies ---

"Calls `f` with every mutable object that `x` is made of, once; does not look into random number generators."
function each_object(f, x, seen = IdDict{Any,Nothing}())
    (isbits(x) || x isa Union{Module,Type,Symbol,String}) && return nothing
    if ismutable(x)
        haskey(seen, x) && return nothing
        seen[x] = nothing
        f(x)
    end
    x isa AbstractRNG || foreach(part -> each_object(f, part, seen), parts(x))
    return nothing
end

parts(x) = (getfield(x, i) for i in 1:nfields(x) if isdefined(x, i))
parts(x::DenseArray) = isbitstype(eltype(x)) ? () : (x[i] for i in eachindex(x) if isassigned(x, i))

"A copy of `x` that shares the objects of `kept`, a `deepcopy`'s dictionary."
own_copy(x, kept) = Base.deepcopy_internal(x, copy(kept))

"The generators within `x` that can be seeded."
function generators(x)
    found = AbstractRNG[]
    each_object(o -> o isa AbstractRNG && applicable(Random.seed!, o, UInt64(0)) && push!(found, o), x)
    return found
end

"Seeds this task's generator and the episode's own from one uniform number."
function seed_all!(rngs, u)
    number = floor(UInt64, u * 2.0^53)
    Random.seed!(number)
    for (k, rng) in enumerate(rngs)
        Random.seed!(rng, number + k * 0x9e3779b97f4a7c15)
    end
end

# --- playing ---

"One episode: its copy of the policy, the updater (`nothing`: exact), the generators of both, belief and last action."
mutable struct Player
    policy::Policy
    updater::Any
    rngs::Vector{AbstractRNG}
    belief::Any
    action::Any
end

"""
    Players(planned, buffers)

A batch of E episodes that `planned` plays. `buffers` is a `NamedTuple` of arrays, which may belong to Python:

| name | size | meaning |
|:--|:--|:--|
| `visible`, `observation`, `marginals`, `done` | E (× Σn) | as in [`Simulator`](@ref), read |
| `numbers` | E | read: uniform numbers for the policy's own choices, new ones for every step |
| `actions` | E | written by [`act!`](@ref): 0-based action indices |
"""
struct Players{B<:NamedTuple}
    planned::Planned
    kept::IdDict{Any,Any}
    players::Vector{Player}
    buffers::B
end

function Players(planned::Planned, buffers::NamedTuple)
    kept = IdDict{Any,Any}()
    each_object(x -> kept[x] = x, planned.model)
    return Players(planned, kept, Vector{Player}(undef, length(buffers.actions)), buffers)
end

"Bytes that every episode's copy of the policy takes, about."
copy_size(p::Planned) = is_shared(p.policy) ? 0 : max(0, Base.summarysize(p.policy) - Base.summarysize(p.model))

"""
    act!(players, watch)

Writes the action of every episode that has not ended. Episodes are shared out among Julia's threads; in the thread that
called, `watch()` is called after each, and what it throws (Ctrl-C) ends the others too.
"""
function act!(p::Players, watch)
    one(e) = in_file(() -> act_one!(p, e), p.planned.file)
    return share_out(e -> p.buffers.done[e] || one(e), length(p.players), watch)
end

function act_one!(p::Players, e)
    isassigned(p.players, e) || (p.players[e] = player(p, e))
    one, b, m = p.players[e], p.buffers, p.planned.model
    seed_all!(one.rngs, b.numbers[e])
    belief = exact_belief(m, Int(b.visible[e]) + 1, Vector{Float64}(view(b.marginals, e, :)))
    one.updater === nothing || (belief = own_belief(one, belief, m, Int(b.observation[e])))
    one.belief = belief
    one.action = action(one.policy, belief)
    b.actions[e] = actionindex(original(m), one.action) - 1
    return nothing
end

function player(p::Players, e)
    policy = is_shared(p.planned.policy) ? p.planned.policy : own_copy(p.planned.policy, p.kept)
    # Seeded before the updater is made, which may draw.
    seed_all!(generators(policy), p.buffers.numbers[e])
    up = p.planned.updater === nothing ? nothing : p.planned.updater(policy)
    rngs = is_shared(policy) && up === nothing ? AbstractRNG[] : generators((policy, up))
    return Player(policy, up, rngs, nothing, nothing)
end

# Samples are of the model's state type, which planners want arrays of.
Base.eltype(::Type{<:FactoredBelief{<:POMDP{S}}}) where {S} = S

"The exact belief as a distribution of the model's states; nothing is enumerated until its `support` is asked for."
exact_belief(m::POMDP, v, marginals) = FactoredBelief(m, v, marginals)
exact_belief(f::Flat, v, marginals) = DiscreteBelief(f.model, f.states, marginals)

"The belief that the policy's own updater keeps; it starts as the exact one, or as the first reading."
function own_belief(one::Player, exact, m, o)
    one.action === nothing && return first_belief(one.updater, exact, o < 0 ? nothing : observation_at(m, o + 1))
    return update(one.updater, one.belief, one.action, observation_at(m, o + 1))
end

first_belief(up::Updater, exact, o) = initialize_belief(up, exact)
first_belief(up::PreviousObservationUpdater, exact, o) = initialize_belief(up, something(o, exact))

"""
Runs `body(i)` for `i` in `1:n` on all threads, each taking the next; `watch()` in between, in the calling one. What one
of them throws ends all, and is thrown when they have ended.
"""
function share_out(body, n, watch)
    next = Threads.Atomic{Int}(1)
    function work(between)
        try
            while (i = Threads.atomic_add!(next, 1)) <= n
                body(i)
                between()
            end
        catch error
            Threads.atomic_max!(next, n + 1)
            return error
        end
        return nothing
    end
    others = [Threads.@spawn(work(Returns(nothing))) for _ in 2:Threads.nthreads()]
    errors = filter!(!isnothing, Any[work(watch); fetch.(others)])
    isempty(errors) || throw(first(errors))
    return nothing
end
