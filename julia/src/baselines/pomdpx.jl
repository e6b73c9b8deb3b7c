# A model as a factored POMDPX file: the visible part as one fully observed variable, one variable a hidden factor.

"""
    write_pomdpx(io, m)

Writes the harnessed model `m` in the POMDPX format of APPL (the C++ SARSOP solver). The visible part is a fully
observed variable; every factor is a variable of its own whose parents are the action, the visible part and itself;
the reward is a sum of functions, one a factor, so that no table spans the joint hidden space.

Throws an `ArgumentError` for a model in which the visible part and the relevant factor move together at random,
which this format cannot say with these variables (solve it with NativeSARSOP instead).
"""
function write_pomdpx(io::IO, m::POMDP)
    println(io, """<?xml version="1.0" encoding="ISO-8859-1"?>\n<pomdpx version="1.0" id="harness">""")
    println(io, "<Discount>$(discount(m))</Discount>")
    println(io, "<Variable>")
    state_variable(io, "visible", nvisible(m), true)
    foreach(k -> state_variable(io, "f$k", hidden_sizes(m)[k], false), eachindex(hidden_sizes(m)))
    tells(m) && println(io, """<ObsVar vname="reading"><NumValues>$(nown(m))</NumValues></ObsVar>""")
    for (j, n) in enumerate(sensor_sizes(m))
        println(io, """<ObsVar vname="sensor$j"><NumValues>$n</NumValues></ObsVar>""")
    end
    println(io, """<ActionVar vname="action"><NumValues>$(length(actions(m)))</NumValues></ActionVar>""")
    foreach(k -> println(io, """<RewardVar vname="reward$k"/>"""), 0:length(hidden_sizes(m)))
    println(io, "</Variable>")
    write_start(io, m)
    write_transitions(io, m)
    write_observations(io, m)
    write_rewards(io, m)
    println(io, "</pomdpx>")
end

"Whether there is a variable for the steps' own observations: where they tell something, or nothing else does."
tells(m) = nown(m) > 1 || !has_sensors(m)

"Factor sizes, with a factor of one value where the model has none: the solver wants a hidden variable."
hidden_sizes(m) = isempty(factor_sizes(m)) ? (1,) : factor_sizes(m)

function state_variable(io, name, n, observed)
    println(io, """<StateVar vnamePrev="$(name)_0" vnameCurr="$(name)_1" fullyObs="$observed"><NumValues>$n</NumValues></StateVar>""")
end

"One conditional table: `entries` are pairs of an instance (space-separated words) and its numbers."
function conditional(io, element, variable, parents, entries; numbers = "ProbTable")
    println(io, "<$element><Var>$variable</Var><Parent>$(join(parents, " "))</Parent><Parameter type=\"TBL\">")
    for (instance, table) in entries
        println(io, "<Entry><Instance>$instance</Instance><$numbers>$table</$numbers></Entry>")
    end
    println(io, "</Parameter></$element>")
end

function write_start(io, m)
    priors = visible_priors(m, initialstate(m))
    marginals = first(values(priors))
    all(≈(marginals), values(priors)) ||
        throw(ArgumentError("what is hidden at the start hangs on what is visible: not supported in POMDPX output"))
    seen = zeros(nvisible(m))
    foreach(((s, p),) -> seen[visible_index(m, s)] += p, weighted_iterator(initialstate(m)))
    println(io, "<InitialStateBelief>")
    conditional(io, "CondProb", "visible_0", ["null"], [("-", words(seen))])
    for k in eachindex(hidden_sizes(m))
        table = isempty(factor_sizes(m)) ? "1.0" : words(marginals[offset(m, k) .+ (1:factor_sizes(m)[k])])
        conditional(io, "CondProb", "f$(k)_0", ["null"], [("-", table)])
    end
    println(io, "</InitialStateBelief>")
end

one_hot(i, n) = [j == i ? 1.0 : 0.0 for j in 1:n]
words(table) = join(table, " ")

# A case is what one (action, visible value) says, for one value `x` of factor `k` or, with `k == 0`, for all.
const Case = @NamedTuple{a::Int, v::Int, k::Int, x::Int, table::Vector{Float64}}

"Cases of (a, v) from the tables by value of factor `k`; one case when the value makes no difference."
function cases_of(a, v, k, tables::Vector{Pair{Int,Vector{Float64}}})
    allequal(last.(tables)) && return [Case((a, v, 0, 1, last(first(tables))))]
    return [Case((a, v, k, x, table)) for (x, table) in tables]
end

"Factors that make a difference in some case: the parents that the table needs."
factor_parents(cases) = sort!(unique!([c.k for c in cases if c.k > 0]))

instance_words(c::Case, parents) =
    join(["a$(c.a - 1)", "s$(c.v - 1)", (k == c.k ? "s$(c.x - 1)" : "*" for k in parents)...], " ")

function write_transitions(io, m)
    moves, changes = Case[], Case[]
    for v in 1:nvisible(m), i in eachindex(actions(m))
        if is_terminal_value(m, v)
            push!(moves, Case((i, v, 0, 1, one_hot(v, nvisible(m)))))
            continue
        end
        a = action_at(m, i)
        k = relevant_factor(m, v, a)
        successors = [x => successor_marginals(m, v, a, k, x) for x in 1:nrows(m, k)]
        append!(moves, cases_of(i, v, k, [x => t[1] for (x, t) in successors]))
        k == 0 || append!(changes, [Case((i, v, k, x, t[2])) for (x, t) in successors])
    end
    println(io, "<StateTransitionFunction>")
    parents = factor_parents(moves)
    conditional(
        io, "CondProb", "visible_1", ["action"; "visible_0"; ["f$(k)_0" for k in parents]],
        [(instance_words(c, parents) * " -", words(c.table)) for c in moves],
    )
    for k in eachindex(hidden_sizes(m))
        mine = [c for c in changes if c.k == k && c.table != one_hot(c.x, length(c.table))]
        entries = [("* * - -", "identity"); [(instance_words(c, [k]) * " -", words(c.table)) for c in mine]]
        conditional(io, "CondProb", "f$(k)_1", ["action", "visible_0", "f$(k)_0"], entries)
    end
    println(io, "</StateTransitionFunction>")
end

"Distributions of the next visible value and of the next value of factor `k`, which must be independent."
function successor_marginals(m, v, a, k, x)
    joint = zeros(nvisible(m), k == 0 ? 1 : factor_sizes(m)[k])
    for (sp, p) in weighted_iterator(transition(m, representative(m, v, k, x), a))
        joint[visible_index(m, sp), k == 0 ? 1 : factor_value(m, sp, k)] += p
    end
    visible, value = vec(sum(joint; dims = 2)), vec(sum(joint; dims = 1))
    isapprox(joint, visible * value'; atol = 1e-12) ||
        throw(ArgumentError("visible part and factor $k move together at random: not expressible, use native-sarsop"))
    return visible, value
end

function write_observations(io, m)
    tables = Dict{NTuple{3,Int},Dict{Int,Vector{Float64}}}()      # (action, next visible value, factor) => value => table
    for v in 1:nvisible(m), i in eachindex(actions(m))
        is_terminal_value(m, v) && continue
        a = action_at(m, i)
        k = relevant_factor(m, v, a)
        for x in 1:nrows(m, k)
            s = representative(m, v, k, x)
            for (sp, p) in weighted_iterator(transition(m, s, a))
                p > 0 || continue
                known = get!(Dict{Int,Vector{Float64}}, tables, (i, visible_index(m, sp), k))
                table = reading_table(m, own_reading(m, s, a, sp))
                get!(known, k == 0 ? 1 : factor_value(m, sp, k), table) == table ||
                    throw(ArgumentError("the observation depends on the previous state: not expressible, use native-sarsop"))
            end
        end
    end
    cases = Case[]
    for (i, v, k) in sort!(collect(keys(tables)))
        append!(cases, cases_of(i, v, k, sort!(collect(tables[(i, v, k)]))))
    end
    parents = factor_parents(cases)
    # The first entry holds wherever no later one does: where nothing hidden matters and the first observation is sure,
    # and in cases that no state leads to, for which the solver still wants a distribution.
    default = one_hot(1, nown(m))
    anything = join(["*", "*", ("*" for _ in parents)..., "-"], " ") => words(default)
    println(io, "<ObsFunction>")
    tells(m) && conditional(
        io, "CondProb", "reading", ["action"; "visible_1"; ["f$(k)_1" for k in parents]],
        [anything; [instance_words(c, parents) * " -" => words(c.table) for c in cases if c.k > 0 || c.table != default]],
    )
    foreach(j -> write_sensor(io, m, j), eachindex(sensor_sizes(m)))
    println(io, "</ObsFunction>")
end

"What sensor `j` reads by action, next visible value and next value of its factor."
function write_sensor(io, m, j)
    k, n = sensor_factors(m)[j], sensor_sizes(m)[j]
    entries = ["* * * -" => words(one_hot(1, n))]
    for v in 1:nvisible(m), x in 1:factor_sizes(m)[k]
        is_terminal_value(m, v) && continue
        tables = [label_table(m, j, action_at(m, i), representative(m, v, k, x), n) for i in eachindex(actions(m))]
        named = allequal(tables) ? ["*" => first(tables)] : ["a$(i - 1)" => table for (i, table) in enumerate(tables)]
        append!(entries, ["$a s$(v - 1) s$(x - 1) -" => words(table) for (a, table) in named])
    end
    conditional(io, "CondProb", "sensor$j", ["action", "visible_1", "f$(k)_1"], entries)
end

function reading_table(m, d)
    table = zeros(nown(m))
    for (o, p) in weighted_iterator(d)
        table[own_index(m, o)] += p
    end
    return table
end

function write_rewards(io, m)
    cases = Case[]
    for v in 1:nvisible(m), i in eachindex(actions(m))
        is_terminal_value(m, v) && continue
        k = relevant_factor(m, v, action_at(m, i))
        append!(cases, cases_of(i, v, k, [x => [expected_reward(m, v, action_at(m, i), k, x)] for x in 1:nrows(m, k)]))
    end
    println(io, "<RewardFunction>")
    for k in 0:length(hidden_sizes(m))
        parents = k == 0 ? Int[] : [k]
        nothing_else = join(["*", "*", ("*" for _ in parents)...], " ") => "0.0"
        entries = [instance_words(c, parents) => words(c.table) for c in cases if c.k == k && c.table != [0.0]]
        names = ["action"; "visible_0"; ["f$(j)_0" for j in parents]]
        conditional(io, "Func", "reward$k", names, [nothing_else; entries]; numbers = "ValueTable")
    end
    println(io, "</RewardFunction>")
end

function expected_reward(m, v, a, k, x)
    s = representative(m, v, k, x)
    return sum(p * reward(m, s, a, sp) for (sp, p) in weighted_iterator(transition(m, s, a)))
end
