# Many episodes in lockstep, stepped by the POMDPs.jl functions of a model. All random numbers come from outside.

"""
    draw(d, u, index)

The value of distribution `d` at the uniform number `u`: inverse CDF over its support in the order of `index`. And what
is left of `u`: its place within the value's share, uniform again and independent of the value.
"""
draw(d::Deterministic, u, index::F) where {F} = d.val, u
function draw(d, u, index::F) where {F}
    chosen = first(support(d))
    total, below, share, previous, found = 0.0, 0.0, 1.0, 0, false
    for (value, p) in weighted_iterator(d)
        p > 0 || continue
        i = index(value)
        i > previous || return draw_sorted(d, u, index)
        previous = i
        found && continue
        chosen, below, share = value, total, p
        total += p
        found = u < total
    end
    return chosen, (u - below) / share
end

"The same for a support that does not come in index order; allocates."
function draw_sorted(d, u, index::F) where {F}
    outcomes = sorted_outcomes(d, index)
    below, i = 0.0, 1
    while i < length(outcomes) && u >= below + outcomes[i].second
        below += outcomes[i].second
        i += 1
    end
    return outcomes[i].first, (u - below) / outcomes[i].second
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
| `u` | E | read: uniform numbers, one gives next state and observation |
| `actions` | E | read: 0-based action indices; −1 leaves the episode as it is |
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
    all(b -> size(b, 1) == length(buffers.actions), buffers) && size(buffers.marginals, 2) in (0, nmarginals(m)) ||
        throw(DimensionMismatch("the buffers of a simulator need one row an episode: $(map(size, buffers))"))
    d = initialstate(m)
    outcomes = sorted_outcomes(d, s -> stateindex(m, s))
    starts = S[first(outcome) for outcome in outcomes]
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
        @inbounds body(sim, e, scratch)
    end
end

"""
    reset!(sim)

Starts all episodes from `buffers.u`: initial states, first readings, initial beliefs given these readings.
"""
reset!(sim::Simulator) = foreach_episode(reset_episode!, sim)

function reset_episode!(sim, e, scratch)
    m, b = sim.model, sim.buffers
    i = min(searchsortedlast(sim.start_cdf, b.u[e]) + 1, length(sim.starts))
    below = i == 1 ? 0.0 : sim.start_cdf[i - 1]
    left = (b.u[e] - below) / (sim.start_cdf[i] - below)
    s = sim.starts[i]
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
    o, _ = draw(d, left, o -> obsindex(m, o))
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

Advances every episode that has not ended by its action in `buffers.actions`; −1 leaves it as it is.
"""
step!(sim::Simulator) = foreach_episode(step_episode!, sim)

Base.@propagate_inbounds function step_episode!(sim, e, scratch)
    m, b = sim.model, sim.buffers
    b.rewards[e] = 0.0
    (b.done[e] || b.actions[e] < 0) && return nothing
    s = sim.states[e]
    a = action_at(m, Int(b.actions[e]) + 1)
    sp, left = draw(transition(m, s, a), b.u[e], x -> stateindex(m, x))
    o, left = draw(own_reading(m, s, a, sp), left, o -> own_index(m, o))
    v, vp = Int(b.visible[e]) + 1, visible_index(m, sp)
    b.rewards[e] = reward(m, s, a, sp)
    b.observation[e] = sensed(m, own_index(m, o), a, sp, left) - 1
    b.visible[e] = vp - 1
    b.done[e] = isterminal(m, sp)
    sim.states[e] = sp
    size(b.marginals, 2) > 0 || return nothing
    k = relevant_factor(m, v, a)
    k > 0 && update_factor!((posterior, prior) -> bayes!(posterior, prior, m, v, a, vp, o, k), b.marginals, e, m, k, scratch)
    has_sensors(m) && !b.done[e] && update_sensed!(b.marginals, e, m, a, vp, Int(b.observation[e]) + 1, scratch)
    return nothing
end

"""
Index of the observation of which the step's own part has the index `own`: with what the sensors read after action `a` led
to `sp`. What each draw leaves of the number `u` goes to the next one.
"""
function sensed(m, own, a, sp, u)
    has_sensors(m) || return own
    i = own - 1
    for (j, n) in enumerate(sensor_sizes(m))
        label = 1
        isterminal(m, sp) || ((label, u) = draw(sensor_reading(m, j, a, sp), u, identity))
        i = i * n + label - 1
    end
    return i + 1
end

function update_sensed!(marginals, e, m, a, vp, i, scratch)
    for (j, k) in enumerate(sensor_factors(m))
        label = sensor_label(m, j, i)
        update_factor!((posterior, prior) -> bayes!(posterior, prior, m, j, a, vp, label), marginals, e, m, k, scratch)
    end
end

"Replaces episode `e`'s belief over factor `k` by what `rule!(posterior, prior)` makes of it."
function update_factor!(rule!::F, marginals, e, m, k, scratch) where {F}
    n, first = factor_sizes(m)[k], offset(m, k)
    prior, posterior = view(scratch, 1:n), view(scratch, (n + 1):(2n))
    for x in 1:n
        prior[x] = marginals[e, first + x]
    end
    rule!(posterior, prior)
    store!(marginals, e, first, posterior)
    return nothing
end

function store!(marginals, e, first, posterior)
    for x in eachindex(posterior)
        marginals[e, first + x] = posterior[x]
    end
end
