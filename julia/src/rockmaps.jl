# The maps of RockSample that the literature plays on, and the sets of rules that it plays by.

"""
A named map: `size` of the square grid, the `rocks` and the `start` of the robot, both 0-based as they were published, `y`
growing northward; `origin` says whose it is.
"""
const RockMap = @NamedTuple{name::String, size::Int, rocks::Vector{Tuple{Int,Int}}, start::Tuple{Int,Int}, origin::String}

# 4x4 to 10x10 are those of T. Smith's generators (ZMDP, src/pomdpModels/gen_RockSample_*), 7x8 and 11x11 those of APPL's
# examples (AdaCompNUS/sarsop, examples/POMDPX); the rocks of 11x11 are those of 10x10 and one more.
# Nobody has published 15x15 and 20x20: there it is n of n² cells drawn once, by Python's random.seed(n) and random.sample.
const ROCK_MAPS = RockMap.([
    ("4x4", 4, [(3, 1), (2, 1), (1, 3), (1, 0)], (0, 2), "the map of ZMDP"),
    ("5x5", 5, [(2, 4), (0, 4), (3, 3), (2, 2), (4, 1)], (0, 2), "the map of ZMDP"),
    ("5x7", 5, [(1, 0), (2, 1), (1, 2), (2, 2), (4, 2), (0, 3), (3, 4)], (0, 2), "the map of ZMDP"),
    (
        "7x8", 7, [(2, 0), (0, 1), (3, 1), (6, 3), (2, 4), (3, 4), (5, 5), (1, 6)], (0, 3),
        "the layout of every published result",
    ),
    (
        "10x10", 10, [(0, 3), (0, 7), (1, 8), (3, 3), (3, 8), (4, 3), (5, 8), (6, 1), (9, 3), (9, 9)], (0, 5),
        "the map of ZMDP",
    ),
    (
        "11x11", 11, [(0, 3), (0, 7), (1, 8), (2, 4), (3, 3), (3, 8), (4, 3), (5, 8), (6, 1), (9, 3), (9, 9)], (0, 5),
        "the published layout",
    ),
    (
        "15x15", 15,
        [
            (1, 4), (2, 0), (4, 0), (4, 6), (7, 2), (8, 3), (8, 12), (9, 0), (9, 11), (9, 14), (10, 2), (11, 13), (12, 11),
            (13, 8), (14, 0),
        ], (0, 7), "a layout of this project (none is published)",
    ),
    (
        "20x20", 20,
        [
            (2, 12), (3, 8), (4, 3), (5, 16), (5, 17), (6, 4), (7, 8), (8, 10), (10, 10), (10, 18), (11, 2), (11, 17), (12, 2),
            (12, 19), (13, 0), (13, 6), (13, 14), (17, 3), (17, 14), (18, 1),
        ], (0, 9), "a layout of this project (none is published)",
    ),
])

"""
What a set of rules has other than the paper's, on a map: keywords of [`RockSample`](@ref), and what titles call it.
The sensors of ZMDP's two smallest maps reach less far than those of the others: there the efficiency is exp(−d) and
2^(−d/4).
"""
const ROCK_RULES = Dict{String,Tuple{Function,String}}(
    "zmdp" => (
        grid -> (;
            empty_sample_penalty = -100.0, illegal_ends = true,
            half_efficiency_distance = get(Dict("4x4" => log(2), "5x5" => 4.0), grid.name, 20.0),
        ), "rules of ZMDP",
    ),
    "rocksample.jl" => (_ -> (; illegal_move_penalty = 0.0, start = (1, 1)), "rules of RockSample.jl"),
    "pobax" => (            # its last column is the exit, and holds no rock
        grid -> (;
            illegal_move_penalty = 0.0, columns = grid.size - 1, rows = grid.size, discount = 0.99,
            starts = [(x, y) for y in 1:(grid.size) for x in 1:(grid.size - 1)],
        ), "rules of pobax (and no rock in the last column)",
    ),
    "noisy" => (_ -> (; best_accuracy = 0.85), "a sensor that errs everywhere"),
)

"The model of a map by a set of rules, `nothing` for the paper's; without the rocks that lie off the grid by these rules."
function on_map(grid::RockMap, rules = nothing)
    changes = rules === nothing ? (;) : ROCK_RULES[rules][1](grid)
    keywords = (; columns = grid.size, start = grid.start .+ 1, changes...)
    return RockSample([c .+ 1 for c in grid.rocks if c[1] < keywords.columns]; keywords...)
end
