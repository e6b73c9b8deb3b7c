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

# Rocks as published, in 0-based (x, y); RockSample(7, 8) and (11, 11) are the layouts of the SARSOP and POMCP papers' files.
const ROCKS_7_8 = [(2, 0), (0, 1), (3, 1), (6, 3), (2, 4), (3, 4), (5, 5), (1, 6)]
const ROCKS_11_11 =
    [(0, 3), (0, 7), (1, 8), (2, 4), (3, 3), (3, 8), (4, 3), (5, 8), (6, 1), (9, 3), (9, 9)]
# There is no published layout of RockSample(15, 15): 15 cells drawn once without replacement (Python's random.seed(15)).
const ROCKS_15_15 = [
    (1, 4), (2, 0), (4, 0), (4, 6), (7, 2), (8, 3), (8, 12), (9, 0), (9, 11), (9, 14), (10, 2), (11, 13), (12, 11),
    (13, 8), (14, 0),
]

# Maps of T. Smith's generators (ZMDP, src/pomdpModels/gen_RockSample_5_5 and _5_7), which start in (0, 2) as here.
const FIELD_5_5 = [(2, 4), (0, 4), (3, 3), (2, 2), (4, 1)]
const FIELD_5_7 = [(1, 0), (2, 1), (1, 2), (2, 2), (4, 2), (0, 3), (3, 4)]

field_on(n, cells) = FieldVision([c .+ 1 for c in cells]; columns = n)
rocks_on(n, cells) = RockSample([c .+ 1 for c in cells]; columns = n)

const BORDERCROSS_HISTORY = [
    "1: first release",
    "2: the potential shaping is Φ(s′) − Φ(s), without γ, as fitness is undiscounted; scores without shaping are as before",
]

const INSTANCES = [
    Instance(
        "rocksample-7x8", 1, "RockSample(7, 8), the layout of every published result", ["1: first release"],
        [SHARED_SOURCES; "rocksample.jl"], () -> rocks_on(7, ROCKS_7_8),
    ),
    Instance(
        "rocksample-11x11", 1, "RockSample(11, 11), the published layout", ["1: first release"],
        [SHARED_SOURCES; "rocksample.jl"], () -> rocks_on(11, ROCKS_11_11),
    ),
    Instance(
        "rocksample-15x15", 1, "RockSample(15, 15), a layout of this project (none is published)", ["1: first release"],
        [SHARED_SOURCES; "rocksample.jl"], () -> rocks_on(15, ROCKS_15_15),
    ),
    Instance(
        "fieldvision-rocksample-5x5", 1, "FieldVisionRockSample(5, 5), every step reads all rocks", ["1: first release"],
        [SHARED_SOURCES; "rocksample.jl"; "fieldvision.jl"], () -> field_on(5, FIELD_5_5),
    ),
    Instance(
        "fieldvision-rocksample-5x7", 1, "FieldVisionRockSample(5, 7), every step reads all rocks", ["1: first release"],
        [SHARED_SOURCES; "rocksample.jl"; "fieldvision.jl"], () -> field_on(5, FIELD_5_7),
    ),
    Instance(
        "bordercross-7x8", 2, "BorderCross, both robots start in known cells", BORDERCROSS_HISTORY,
        [SHARED_SOURCES; "bordercross.jl"], () -> BorderCross(),
    ),
    Instance(
        "bordercross-7x8-random", 2, "BorderCross, robot 2 starts hidden in columns 1 to 3", BORDERCROSS_HISTORY,
        [SHARED_SOURCES; "bordercross.jl"], () -> BorderCross(; start2 = [(r, c) for r in 1:7 for c in 1:3]),
    ),
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
