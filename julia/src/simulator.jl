# Many episodes in lockstep, stepped by the POMDPs.jl functions of a model. All random numbers come from outside.

"""
    draw(d, u, index)

The value of distribution `d` at the uniform number `u`: inverse CDF over its support in the order of `index`.
"""
draw(d::Deterministic, u, index::F) where {F} = d.val
function draw(d, u, index::F) where {F}
    chosen = first(support(d))
    total, previous, found = 0.0, 0, false
    for (value, p) in weighted_iterator(d)
        p > 0 || continue
        i = index(value)
        i > previous || return draw_sorted(d, u, index)
        previous = i
        found && continue
        chosen = value
        total += p
        found = u < total
    end
    return chosen
end

"The same for a support that does not come in index order; allocates."
function draw_sorted(d, u, index::F) where {F}
    total = 0.0
    outcomes = sorted_outcomes(d, index)
    for (value, p) in outcomes
        total += p
        u < total && return value
    end
    return last(outcomes).first
end

"Outcomes `value => probability` of `d` in index order, equal values added up, none of probability zero."
function sorted_outcomes(d, index::F) where {F}
    outcomes = sort!([v => p for (v, p) in weighted_iterator(d) if p > 0]; by = index ∘ first)
    merged = empty(outcomes)
    for (value, p) in outcomes
        if !isempty(merged) && index(last(merged).first) == index(value)
            merged[end] = value => last(merged).second + p
        else
            push!(merged, value => p)
        end
    end
    return merged
end

"""
    Simulator(m, buffers)

A batch of E episodes of the (harnessed) model `m`. `buffers` is a `NamedTuple` of arrays, which may belong
to Python; [`reset!`](@ref) and [`step!`](@ref) read and write them in place:

| name | size | meaning |
|:--|:--|:--|
| `u` | E × 2 | read: uniform numbers for the state and for the observation |
| `actions` | E | read: 0-based action indices |
| `rewards` | E | reward of the last step, 0 for an episode that had ended |
| `visible` | E | 0-based visible index |
| `observation` | E | 0-based index of the last observation, −1 when there is none yet |
| `done` | E | whether the episode has ended (a terminal state) |
| `marginals` | E × Σn | belief over the hidden factors; E × 0: not tracked |
"""
struct Simulator{M,S,B<:NamedTuple,V<:AbstractVector{S}}
    model::M
    starts::V
    start_cdf::Vector{Float64}
    priors::Dict{Int,Vector{Float64}}
    states::Vector{S}
    scratch::Vector{Vector{Float64}}
    buffers::B
end

function Simulator(m::POMDP{S}, buffers::NamedTuple) where {S}
    d = initialstate(m)
    outcomes = sorted_outcomes(d, s -> stateindex(m, s))
    starts = first.(outcomes)
    longest = maximum(factor_sizes(m); init = 1)
    return Simulator(
        m, starts, accumulate(+, last.(outcomes)), visible_priors(m, d),
        Vector{S}(undef, length(buffers.actions)), [zeros(2longest) for _ in 1:Threads.nthreads()], buffers,
    )
end

"Runs `body(sim, e, scratch)` for every episode, in as many threads as Julia has."
function foreach_episode(body::F, sim::Simulator) where {F}
    E, n = length(sim.states), length(sim.scratch)
    if n == 1 || E < 512
        run_range(body, sim, 1:E, sim.scratch[1])
    else
        Threads.@threads :static for i in 1:n
            run_range(body, sim, (1 + (i - 1) * E ÷ n):(i * E ÷ n), sim.scratch[i])
        end
    end
    return nothing
end

function run_range(body::F, sim, range, scratch) where {F}
    for e in range
        body(sim, e, scratch)
    end
end

"""
    reset!(sim)

Starts all episodes from `buffers.u`: initial states, first readings, initial beliefs given these readings.
"""
reset!(sim::Simulator) = foreach_episode(reset_episode!, sim)

function reset_episode!(sim, e, scratch)
    m, b = sim.model, sim.buffers
    i = searchsortedlast(sim.start_cdf, b.u[e, 1]) + 1
    s = sim.starts[min(i, length(sim.starts))]
    v = visible_index(m, s)
    sim.states[e] = s
    b.visible[e] = v - 1
    b.done[e] = isterminal(m, s)
    b.rewards[e] = 0.0
    track = size(b.marginals, 2) > 0
    if track
        prior = sim.priors[v]
        for j in eachindex(prior)
            b.marginals[e, j] = prior[j]
        end
    end
    d = first_reading(m, s)
    if d === nothing
        b.observation[e] = -1
        return nothing
    end
    o = draw(d, b.u[e, 2], o -> obsindex(m, o))
    b.observation[e] = obsindex(m, o) - 1
    k = relevant_factor(m, v)
    if track && k > 0
        n = factor_sizes(m)[k]
        prior, posterior = view(scratch, 1:n), view(scratch, (n + 1):(2n))
        for x in 1:n
            prior[x] = b.marginals[e, offset(m, k) + x]
            posterior[x] = prior[x] > 0 ? prior[x] * pdf(first_reading(m, representative(m, v, k, x)), o) : 0.0
        end
        normalize_first!(posterior, prior)
        store!(b.marginals, e, offset(m, k), posterior)
    end
    return nothing
end

"""
    step!(sim)

Advances every episode that has not ended by its action in `buffers.actions`.
"""
step!(sim::Simulator) = foreach_episode(step_episode!, sim)

function step_episode!(sim, e, scratch)
    m, b = sim.model, sim.buffers
    b.rewards[e] = 0.0
    b.done[e] && return nothing
    s = sim.states[e]
    a = action_at(m, Int(b.actions[e]) + 1)
    sp = draw(transition(m, s, a), b.u[e, 1], x -> stateindex(m, x))
    o = draw(observation(m, s, a, sp), b.u[e, 2], o -> obsindex(m, o))
    v, vp = Int(b.visible[e]) + 1, visible_index(m, sp)
    b.rewards[e] = reward(m, s, a, sp)
    b.observation[e] = obsindex(m, o) - 1
    b.visible[e] = vp - 1
    b.done[e] = isterminal(m, sp)
    sim.states[e] = sp
    size(b.marginals, 2) > 0 || return nothing
    k = relevant_factor(m, v, a)
    k > 0 || return nothing
    n, first = factor_sizes(m)[k], offset(m, k)
    prior, posterior = view(scratch, 1:n), view(scratch, (n + 1):(2n))
    for x in 1:n
        prior[x] = b.marginals[e, first + x]
    end
    bayes!(posterior, prior, m, v, a, vp, o, k)
    store!(b.marginals, e, first, posterior)
    return nothing
end

function store!(marginals, e, first, posterior)
    for x in eachindex(posterior)
        marginals[e, first + x] = posterior[x]
    end
end
