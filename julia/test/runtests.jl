using POMDPs, POMDPTools
using PomdpHarness
using Random, Test
using PomdpHarness: PomdpHarness as H

include("models.jl")

# Small models on which everything can be enumerated.
const SMALL_ROCKS = RockSample([(2, 1), (1, 2), (3, 3)]; columns = 3)
const SMALL_BORDER = BorderCross(; rows = 3, columns = 5, start1 = (2, 1), start2 = [(3, 2)])
const SMALL_HIDDEN = BorderCross(; rows = 3, columns = 5, start1 = (2, 1), start2 = [(r, c) for r in 1:3 for c in 1:2])
const SMALL_DEC = DecBorderCross(; rows = 3, columns = 5, start1 = (2, 1), start2 = [(3, 2)], max_reading = 4)
const SMALL_DEC_HIDDEN =
    DecBorderCross(; rows = 3, columns = 5, start1 = (2, 1), start2 = [(r, c) for r in 1:3 for c in 1:2], max_reading = 4)
const SMALL = [SMALL_ROCKS, SMALL_BORDER, SMALL_HIDDEN, SMALL_DEC, SMALL_DEC_HIDDEN]

"""
POMDPTools' `has_consistent_distributions` compares every pair of states for every action, 2·10⁹ of them on
RockSample(7, 8). This looks only at the states that a transition leads to.
"""
function consistent_where_it_leads(m)
    has_consistent_initial_distribution(m) || return false
    for s in states(m), a in actions(m)
        d = transition(m, s, a)
        sum(last, weighted_iterator(d)) ≈ 1 || return false
        for sp in support(d)
            sp in states(m) || return false
            o = observation(m, s, a, sp)
            sum(pdf(o, x) for x in observations(m)) ≈ 1 || return false
            all(x -> pdf(o, x) >= 0, observations(m)) || return false
        end
    end
    return true
end

@testset "PomdpHarness" begin
    @testset "$file" for file in [
        "rocksample.jl", "bordercross.jl", "interface.jl", "updater.jl", "simulator.jl", "tables.jl", "instances.jl",
        "fieldvision.jl", "decbordercross.jl", "grids.jl", "baselines.jl", "players.jl", "outside.jl", "momdps.jl", "hygiene.jl",
    ]
        include(file)
    end
end
