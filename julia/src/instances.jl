# The named instances. A version rises when results of the instance could change; the history says why.

"""
    Instance

A named model: `make()` builds it, `version` rises whenever scores on it could change (`history` says why),
`sources` are the files of `src/` that define it.
"""
struct Instance
    name::String
    version::Int
    title::String
    history::Vector{String}
    sources::Vector{String}
    make::Function
end

const SHARED_SOURCES = ["interface.jl", "instances.jl", "updater.jl", "simulator.jl", "tables.jl"]

# Which maps of RockSample are played by which rules; by `nothing` else, the paper's.
const ROCK_INSTANCES = [
    nothing => ["4x4", "5x5", "5x7", "7x8", "10x10", "11x11", "15x15", "20x20"],
    "zmdp" => ["4x4", "5x5", "5x7", "7x8", "10x10", "11x11"],
    "rocksample.jl" => ["7x8"], "pobax" => ["7x8"], "noisy" => ["7x8"],
]

function field_instance(name)
    grid = only(grid for grid in ROCK_MAPS if grid.name == name)
    cells = [c .+ 1 for c in grid.rocks]
    title = "FieldVisionRockSample($(grid.size), $(length(cells))), every step reads all rocks"
    return Instance(
        "fieldvision-rocksample-$name", 1, title, ["1: first release"],
        [SHARED_SOURCES; "rocksample.jl"; "rockmaps.jl"; "fieldvision.jl"],
        () -> FieldVision(cells; columns = grid.size, start = grid.start .+ 1),
    )
end

function rock_instance(name, rules)
    grid = only(grid for grid in ROCK_MAPS if grid.name == name)
    title = "RockSample($(grid.size), $(length(grid.rocks))), $(rules === nothing ? grid.origin : ROCK_RULES[rules][2])"
    return Instance(
        rules === nothing ? "rocksample-$name" : "rocksample-$name@$rules", 1, title, ["1: first release"],
        [SHARED_SOURCES; "rocksample.jl"; "rockmaps.jl"], () -> on_map(grid, rules),
    )
end

const BORDERCROSS_HISTORY = [
    "1: first release",
    "2: the potential shaping is Φ(s′) − Φ(s), without γ, as fitness is undiscounted; scores without shaping are as before",
]

const BORDERCROSS_STARTS = [(r, c) for r in 1:7 for c in 1:3]     # where robot 2 hides

"An instance whose whole state is hidden: one factor, as any model of POMDPs.jl."
hidden_instance(name, title, sources, make) =
    Instance(name, 1, title, ["1: first release"], [SHARED_SOURCES; "flat.jl"; sources], () -> Flat(make()))

const INSTANCES = [
    [rock_instance(name, rules) for (rules, names) in ROCK_INSTANCES for name in names]
    [field_instance(name) for name in ["5x5", "5x7"]]
    Instance(
        "bordercross-7x8", 2, "BorderCross, both robots start in known cells", BORDERCROSS_HISTORY,
        [SHARED_SOURCES; "gridmap.jl"; "bordercross.jl"], () -> BorderCross(),
    )
    Instance(
        "bordercross-7x8-random", 2, "BorderCross, robot 2 starts hidden in columns 1 to 3", BORDERCROSS_HISTORY,
        [SHARED_SOURCES; "gridmap.jl"; "bordercross.jl"],
        () -> BorderCross(; start2 = BORDERCROSS_STARTS),
    )
    Instance(
        "dec-bordercross-7x8", 1, "DecBorderCross, both robots act at once, each by its own reading", ["1: first release"],
        [SHARED_SOURCES; "gridmap.jl"; "bordercross.jl"; "decbordercross.jl"], () -> DecBorderCross(),
    )
    Instance(
        "dec-bordercross-7x8-random", 1, "DecBorderCross, robot 2 starts hidden in columns 1 to 3", ["1: first release"],
        [SHARED_SOURCES; "gridmap.jl"; "bordercross.jl"; "decbordercross.jl"],
        () -> DecBorderCross(; start2 = BORDERCROSS_STARTS),
    )
    Instance(
        "tag", 1, "Tag, an opponent hides in 29 cells", ["1: first release"],
        [SHARED_SOURCES; "gridmap.jl"; "tag.jl"], () -> Tag(),
    )
    Instance(
        "heaven-hell", 1, "HeavenHell, a priest knows the way", ["1: first release"],
        [SHARED_SOURCES; "gridmap.jl"; "heavenhell.jl"], () -> HeavenHell(),
    )
    hidden_instance("tiger", "Tiger, behind one of two doors", ["tiger.jl"], () -> Tiger())
    hidden_instance(
        "tiger-grid", "TigerGrid, a goal between two traps", ["gridmap.jl", "littman.jl"],
        () -> LittmanGrid(["-*+*-", "*^ ^*"]),
    )
    hidden_instance(
        "hallway", "Hallway, a corridor with alcoves and landmarks", ["gridmap.jl", "littman.jl"],
        () -> LittmanGrid(["**o*o*o*o**", "  * * * +  "]),
    )
    hidden_instance(
        "hallway2", "Hallway2, corridors that look alike", ["gridmap.jl", "littman.jl"],
        () -> LittmanGrid([" ***** ", "** * **", " * * * ", "** * *+", " ***** "]),
    )
]

"""
    instance(name)

The [`Instance`](@ref) called `name`. Throws an `ArgumentError` that lists the known ones.
"""
function instance(name::AbstractString)
    i = findfirst(x -> x.name == name, INSTANCES)
    i === nothing && throw(ArgumentError("no domain '$name'; known: $(join((x.name for x in INSTANCES), ", "))"))
    return INSTANCES[i]
end

"""
    source_hash(files)

SHA-256 (hexadecimal) of the named files of `src/`, each as its name, a newline and its bytes, in the order given.
"""
function source_hash(files)
    context = SHA.SHA2_256_CTX()
    for file in files
        SHA.update!(context, codeunits(file * "\n"))
        SHA.update!(context, read(joinpath(@__DIR__, file)))
    end
    return bytes2hex(SHA.digest!(context))
end

"Versions of Julia and of the packages that what we export comes from."
versions() = Dict{String,String}(
    "julia" => string(VERSION),
    (string(nameof(p)) => string(pkgversion(p)) for p in
        (PomdpHarness, POMDPs, POMDPTools, QMDP, NativeSARSOP, DiscreteValueIteration, SARSOP_jll))...,
)
