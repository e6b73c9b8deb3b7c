"""
The domains of the POMDP benchmark harness, defined once, for every engine: POMDPs.jl models with the names,
the visible parts and the belief features that policies speak of, a simulator of many episodes in lockstep,
exact belief updates, the baselines, and the export to arrays.
"""
module PomdpHarness

using DiscreteValueIteration: DiscreteValueIteration, SparseValueIterationSolver
using NativeSARSOP: NativeSARSOP
using POMDPs
using POMDPTools
using QMDP: QMDP, QMDPSolver
using Random: Random, AbstractRNG, randperm
using SARSOP_jll: SARSOP_jll
using SHA: SHA
using SpecialFunctions: erf
using StaticArrays: SVector, setindex

export RockSample, RockState, FieldVision, BorderCross, BorderState, DecBorderCross, FactoredUpdater, FactoredBelief, belief_updater
export UP, RIGHT, DOWN, LEFT, SAMPLE, COOPERATE, check, instance
export OutsidePolicy, python_policy
export action_names, observation_names, belief_features, layout, shapings, shaped

include("interface.jl")
include("flat.jl")
include("gridmap.jl")
include("rocksample.jl")
include("rockmaps.jl")
include("fieldvision.jl")
include("bordercross.jl")
include("decbordercross.jl")
include("tag.jl")
include("heavenhell.jl")
include("tiger.jl")
include("littman.jl")
include("updater.jl")
include("simulator.jl")
include("tables.jl")
include("instances.jl")
include("userfiles.jl")
include("players.jl")
include("outside.jl")
include("baselines/alpha.jl")
include("baselines/mdp.jl")
include("baselines/qmdp.jl")
include("baselines/pomdpx.jl")
include("baselines/sarsop.jl")
include("baselines/native_sarsop.jl")

end
