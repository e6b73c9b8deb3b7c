# A model as arrays: everything that the embedded Python engine needs to step it without Julia.

"""
    tables(m)

The harnessed model `m` as a `NamedTuple` of arrays with 0-based indices, computed by calling its POMDPs.jl
functions. For visible value v and action a, `factor[v·A + a]` is the relevant hidden factor (−1: none) and
`first_row[v·A + a]` the first of its rows, one a value of that factor (−1 at a terminal v). Row r owns the
outcomes `row_outcomes[r] … row_outcomes[r+1] − 1`, in the order of the next states' indices:

- `outcome_visible, outcome_value`: next visible value, next value of the relevant factor
- `outcome_probability, outcome_cdf`: probability, and its running sum within the row
- `outcome_observation`: row of `observation_probability` and `observation_cdf` (rows × steps' own observations)
- `outcome_reward`: shapings × outcomes, the true reward first

`legal[r]` says whether the action is in `actions(m, s)`. The initial distribution is `start_visible,
start_values` (starts × factors), `start_cdf, start_observation` (row of the first reading, −1: none), with
the marginals of the hidden factors in `prior_marginals`, one row for each visible value of `prior_visible`;
`prior_factor` is the factor that the first reading tells of, `prior_observation` its reading's row for each value.

Sensors read unasked: `sensor_row[v·A + a, j]` is, at the next visible value v, the row of `sensor_probability` and
`sensor_cdf` (rows × most labels) for the first value of sensor j's factor, the others following; −1 at a terminal v.
"""
function tables(m::POMDP)
    V, A = nvisible(m), length(actions(m))
    models = [shaped(m, name) for name in shapings(m)]
    readings = Readings(m)
    first_row, factor = fill(-1, V * A), fill(-1, V * A)
    terminal = [is_terminal_value(m, v) for v in 1:V]
    legal, row_outcomes = Bool[], [0]
    outcomes = (visible = Int[], value = Int[], probability = Float64[], cdf = Float64[], observation = Int[])
    rewards = [Float64[] for _ in models]
    for v in 1:V, i in 1:A
        terminal[v] && continue
        a = action_at(m, i)
        k = relevant_factor(m, v, a)
        first_row[(v - 1) * A + i] = length(legal)
        factor[(v - 1) * A + i] = k - 1
        for x in 1:nrows(m, k)
            s = representative(m, v, k, x)
            push!(legal, a in actions(m, s))
            total = 0.0
            for (sp, p) in next_states(m, s, a)
                total += p
                push!(outcomes.visible, visible_index(m, sp) - 1)
                push!(outcomes.value, k == 0 ? 0 : factor_value(m, sp, k) - 1)
                push!(outcomes.probability, p)
                push!(outcomes.cdf, total)
                push!(outcomes.observation, row!(readings, reading(m, s, a, sp)))
                foreach((list, model) -> push!(list, paid(model, s, a, sp)), rewards, models)
            end
            push!(row_outcomes, length(outcomes.visible))
        end
    end
    start = start_tables(m, readings)
    return (;
        first_row, factor, terminal, legal, row_outcomes,
        outcome_visible = outcomes.visible, outcome_value = outcomes.value,
        outcome_probability = outcomes.probability, outcome_cdf = outcomes.cdf,
        outcome_observation = outcomes.observation, outcome_reward = stack(rewards; dims = 1),
        start..., observation_probability = stack(readings.rows; dims = 1),
        observation_cdf = accumulate(+, stack(readings.rows; dims = 1); dims = 2),
        visible_values = stack([visible_values(m, v) for v in 1:V]; dims = 1), sensor_tables(m)...,
    )
end

function sensor_tables(m)
    V, A, most = nvisible(m), length(actions(m)), maximum(sensor_sizes(m); init = 0)
    row = fill(-1, V * A, length(sensor_factors(m)))
    distributions, known = Vector{Float64}[], Dict{Vector{Vector{Float64}},Int}()
    for (j, k) in enumerate(sensor_factors(m)), v in 1:V, i in 1:A
        is_terminal_value(m, v) && continue
        block = [label_table(m, j, action_at(m, i), representative(m, v, k, x), most) for x in 1:factor_sizes(m)[k]]
        row[(v - 1) * A + i, j] = get!(known, block) do
            append!(distributions, block)
            return length(distributions) - length(block)
        end
    end
    probability = isempty(distributions) ? zeros(0, most) : stack(distributions; dims = 1)
    return (sensor_row = row, sensor_probability = probability, sensor_cdf = accumulate(+, probability; dims = 2))
end

"Probabilities of the labels of sensor `j` when action `a` has led to `sp`, with zeros up to `n` of them."
function label_table(m, j, a, sp, n)
    table = zeros(n)
    for (label, p) in weighted_iterator(sensor_reading(m, j, a, sp))
        table[label] += p
    end
    return table
end

# A flat model's terminal states have rows too, which no episode meets. A model need not say what happens there.
next_states(m, s, a) =
    isterminal(m, s) ? [s => 1.0] : sorted_outcomes(transition(m, s, a), y -> stateindex(m, y))
reading(m, s, a, sp) = isterminal(m, s) ? Deterministic(observation_at(m, 1)) : own_reading(m, s, a, sp)
paid(m, s, a, sp) = isterminal(m, s) ? 0.0 : reward(m, s, a, sp)

is_terminal_value(m, v) = isterminal(m, representative(m, v, 0, 1))
is_terminal_value(::Flat, v) = v == 2

"The different distributions of steps' own observations met so far, each a row of probabilities in index order."
struct Readings{M}
    model::M
    rows::Vector{Vector{Float64}}
    index::Dict{Vector{Float64},Int}
end
Readings(m) = Readings(m, Vector{Float64}[], Dict{Vector{Float64},Int}())

"0-based row of distribution `d`, added when it is new; −1 for no observation."
row!(readings::Readings, ::Nothing) = -1
function row!(readings::Readings, d)
    row = zeros(nown(readings.model))
    for (o, p) in weighted_iterator(d)
        row[own_index(readings.model, o)] += p
    end
    return get!(readings.index, row) do
        push!(readings.rows, row)
        return length(readings.rows) - 1
    end
end

function start_tables(m, readings)
    K = length(factor_sizes(m))
    outcomes = sorted_outcomes(initialstate(m), s -> stateindex(m, s))
    priors = sort!(collect(visible_priors(m, initialstate(m))); by = first)
    longest = maximum(factor_sizes(m); init = 1)
    prior_factor = [relevant_factor(m, v) - 1 for (v, _) in priors]
    prior_observation = fill(-1, length(priors), longest)
    for (i, (v, marginals)) in enumerate(priors), x in 1:nrows(m, prior_factor[i] + 1)
        k = prior_factor[i] + 1
        k == 0 || marginals[offset(m, k) + x] > 0 || continue
        prior_observation[i, x] = row!(readings, first_reading(m, representative(m, v, k, x)))
    end
    return (
        start_visible = [visible_index(m, s) - 1 for (s, _) in outcomes],
        start_values = [factor_value(m, s, k) - 1 for (s, _) in outcomes, k in 1:K],
        start_cdf = accumulate(+, last.(outcomes)),
        start_observation = [row!(readings, first_reading(m, s)) for (s, _) in outcomes],
        prior_visible = first.(priors) .- 1,
        prior_marginals = [p[2][j] for p in priors, j in 1:nmarginals(m)],
        prior_factor, prior_observation,
    )
end

"""
    describe(m)

Names and sizes of the harnessed model `m`: what a Python `Domain` holds beside the tables.
"""
function describe(m::POMDP)
    described = Dict{String,Any}(
        "discount" => discount(m), "states" => length(states(m)),
        "actions" => action_names(m), "observations" => observation_names(m),
        "visible" => visible_names(m), "factors" => factor_names(m),
        "factor_labels" => [factor_labels(m, k) for k in eachindex(factor_sizes(m))],
        "features" => [Any[name, k - 1, x - 1] for (name, k, x) in belief_features(m)],
        "shapings" => shapings(m), "layout" => layout(m),
    )
    if has_sensors(m)
        described["sensors"] =
            [Any[name, k - 1, sensor_labels(m, j)] for (j, (name, k)) in enumerate(zip(sensor_names(m), sensor_factors(m)))]
    end
    agents = [Any[name, agent_actions(m, i), agent_observations(m, i)] for (i, name) in enumerate(agent_names(m))]
    isempty(agents) || (described["agents"] = agents)
    return described
end
