# Exact beliefs over independent hidden factors: one factor is updated at a step, by Bayes' rule.

"""
    FactoredBelief

Belief of a model with a visible part and independent hidden factors: the visible index and the factors'
marginals, concatenated (see `factor_sizes`). Their product is the joint belief, exactly.
"""
struct FactoredBelief{M}
    model::M
    visible::Int
    marginals::Vector{Float64}
end

"Probability that hidden factor `k` has the value `x`."
marginal(b::FactoredBelief, k, x) = b.marginals[offset(b.model, k) + x]

function POMDPs.pdf(b::FactoredBelief, s)
    m = b.model
    visible_index(m, s) == b.visible || return 0.0
    return prod(marginal(b, k, factor_value(m, s, k)) for k in eachindex(factor_sizes(m)); init = 1.0)
end

function POMDPs.support(b::FactoredBelief)
    m = b.model
    all_states = (assemble(m, b.visible, joint_values(m, h)) for h in 1:joint_size(m))
    return [s for s in all_states if pdf(b, s) > 0]
end

Base.rand(rng::AbstractRNG, d::Random.SamplerTrivial{<:FactoredBelief}) = draw_state(rng, d[])
function draw_state(rng, b::FactoredBelief)
    m = b.model
    values = map(eachindex(factor_sizes(m))) do k
        u, x = rand(rng), 1
        while (u -= marginal(b, k, x)) >= 0 && x < factor_sizes(m)[k]
            x += 1
        end
        return x
    end
    return assemble(m, b.visible, values)
end

"""
    FactoredUpdater(m)

Exact belief updater of a model that describes its hidden factors, as [`RockSample`](@ref) and
[`BorderCross`](@ref) do. For RockSample one step is equation 1 (reading good), 2 (reading bad) or
belief 0 after sampling. The agent is taken to know whether the episode has ended.
"""
struct FactoredUpdater{M} <: Updater
    model::M
end

"""
    belief_updater(m)

The exact updater for `m`: [`FactoredUpdater`](@ref) where the model describes its factors, POMDPTools'
`DiscreteUpdater` for any other finite model.
"""
belief_updater(m::POMDP) = applicable(nvisible, m) ? FactoredUpdater(m) : DiscreteUpdater(m)

function POMDPs.initialize_belief(up::FactoredUpdater, d)
    priors = visible_priors(up.model, d)
    length(priors) == 1 || throw(ArgumentError("the initial visible part is random: make one belief a visible value"))
    visible, marginals = only(priors)
    return FactoredBelief(up.model, visible, marginals)
end
POMDPs.initialize_belief(::FactoredUpdater, b::FactoredBelief) = b

"Marginals of the hidden factors under `d`, for each visible value that `d` gives: a `Dict`."
function visible_priors(m, d)
    priors = Dict{Int,Vector{Float64}}()
    for (s, p) in weighted_iterator(d)
        p > 0 || continue
        marginals = get!(() -> zeros(nmarginals(m)), priors, visible_index(m, s))
        for k in eachindex(factor_sizes(m))
            marginals[offset(m, k) + factor_value(m, s, k)] += p
        end
    end
    for marginals in values(priors), (k, n) in enumerate(factor_sizes(m))
        range = offset(m, k) .+ (1:n)
        marginals[range] ./= sum(marginals[range])
    end
    return priors
end

function POMDPs.update(up::FactoredUpdater, b::FactoredBelief, a, o)
    m = up.model
    k = relevant_factor(m, b.visible, a)
    visible = next_visible(m, b, a, k)
    k == 0 && !has_sensors(m) && return FactoredBelief(m, visible, b.marginals)
    marginals = copy(b.marginals)
    of_factor(k) = view(marginals, (offset(m, k) + 1):(offset(m, k) + factor_sizes(m)[k]))
    k == 0 || bayes!(of_factor(k), copy(of_factor(k)), m, b.visible, a, visible, own_part(m, o), k)
    for (j, k) in enumerate(is_terminal_value(m, visible) ? () : sensor_factors(m))
        bayes!(of_factor(k), copy(of_factor(k)), m, j, a, visible, sensor_label(m, j, obsindex(m, o)))
    end
    return FactoredBelief(m, visible, marginals)
end

"The visible value after action `a` in an episode that goes on; the terminal one where it cannot go on."
function next_visible(m, b::FactoredBelief, a, k)
    found = 0
    for x in 1:nrows(m, k)
        (k == 0 || marginal(b, k, x) > 0) || continue
        for (sp, p) in weighted_iterator(transition(m, representative(m, b.visible, k, x), a))
            p > 0 || continue
            v = visible_index(m, sp)
            if found == 0 || (found != v && isterminal(m, representative(m, found, 0, 1)))
                found = v
            elseif found != v && !isterminal(m, sp)
                throw(ArgumentError("the next visible part is random: update with `bayes!`, which takes it"))
            end
        end
    end
    return found
end

"""
    bayes!(posterior, prior, m, v, a, vp, o, k)

Belief over factor `k` after action `a` at visible value `v` led to visible value `vp` and the step's own observation `o`;
all other factors stay as they were. Sums run in index order, so that the `tables` engine, which does the
same on the exported numbers, gets the same bits. Returns the probability of `(vp, o)`; when that is zero,
the belief is left as it was.
"""
function bayes!(posterior, prior, m, v, a, vp, o, k)
    n = length(posterior)
    n == length(prior) == factor_sizes(m)[k] ||
        throw(DimensionMismatch("factor $k has $(factor_sizes(m)[k]) values, the beliefs $n and $(length(prior))"))
    @inbounds for x in 1:n
        posterior[x] = 0.0
    end
    for x in 1:n        # bounds stay checked: the index written to is what the model says it is
        b = prior[x]
        b > 0 || continue
        s = representative(m, v, k, x)
        for (sp, p) in weighted_iterator(transition(m, s, a))
            (p > 0 && visible_index(m, sp) == vp) || continue
            posterior[factor_value(m, sp, k)] += b * p * pdf(own_reading(m, s, a, sp), o)
        end
    end
    return normalize_first!(posterior, prior)
end

"""
    bayes!(posterior, prior, m, j, a, vp, label)

Belief over the factor of sensor `j` after it read the label with index `label`, where action `a` had led to visible value
`vp`; what the step itself told comes before.
"""
function bayes!(posterior, prior, m, j, a, vp, label)
    k = sensor_factors(m)[j]
    for x in eachindex(posterior)
        posterior[x] = prior[x] * pdf(sensor_reading(m, j, a, representative(m, vp, k, x)), label)
    end
    return normalize_first!(posterior, prior)
end

"""
Divides by the total. The first entry is one minus the others, so that a two-valued factor follows
equations 1 and 2 to the letter: only the probability of the second value ("good") is a number of its own.
"""
function normalize_first!(posterior, prior)
    n = length(posterior)
    n == length(prior) || throw(DimensionMismatch("beliefs of $n and $(length(prior)) values"))
    total = 0.0
    @inbounds for x in 1:n
        total += posterior[x]
    end
    if total <= 0
        posterior .= prior
        return 0.0
    end
    @inbounds for x in 1:n
        posterior[x] /= total
    end
    n == 2 && (posterior[1] = 1.0 - posterior[2])
    return total
end
