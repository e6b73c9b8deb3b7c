# SARSOP (Kurniawati, Hsu and Lee 2008): APPL's C++ solver on the factored, mixed-observability POMDPX file.

"""
    solve_sarsop(m; timeout, precision, folder, progress)

Solves the harnessed model `m` with the `pomdpsol` program of SARSOP_jll and reads its policy back.

- `timeout` (seconds, default 600), `precision` (default 1e-3: stop when the bounds at the start are that close):
  handed to the solver, which stops at the first that is reached. (Its memory limit is left alone: with any, it fails to
  load RockSample(11, 11), which takes 3 GB.)
- `folder`: where `model.pomdpx` and `policy.out` are written (default: a temporary folder)
- `progress(seconds, lower, upper)`: called for every line in which the solver reports its bounds; when it returns
  `false`, the solver is told to stop and write what it has

Returns the [`AlphaVectors`](@ref) and what to record with them: solver, limits, seconds, lower and upper bound at
the initial belief.
"""
function solve_sarsop(
    m::POMDP; timeout::Real = 600, precision::Real = 1e-3, folder = mktempdir(),
    progress = (seconds, lower, upper) -> true,
)
    model, output = joinpath(folder, "model.pomdpx"), joinpath(folder, "policy.out")
    open(io -> write_pomdpx(io, m), model, "w")
    command = `$(SARSOP_jll.pomdpsol()) $model --timeout $timeout --precision $precision --output $output`
    bounds, log = run_solver(command, progress)
    isfile(output) || error("pomdpsol wrote no policy; its last words:\n" * join(last(log, 10), "\n"))
    record = Dict{String,Any}(
        "solver" => "SARSOP (APPL, pomdpsol)", "timeout" => timeout, "precision" => precision,
        "seconds" => bounds.seconds, "lower" => bounds.lower, "upper" => bounds.upper,
    )
    return AlphaVectors(m, read_policy(output, m)), record
end

"Runs the solver; returns the last bounds that it reported, and all that it printed."
function run_solver(command, progress)
    bounds, log = (; seconds = 0.0, lower = -Inf, upper = Inf), String[]
    process = open(pipeline(command; stderr = stdout))
    try
        for line in eachline(process)
            push!(log, line)
            found = parse_bounds(line)
            found === nothing && continue
            bounds = found
            progress(bounds...) == false && kill(process, Base.SIGINT)
        end
        wait(process)
    catch
        kill(process, Base.SIGINT)
        rethrow()
    end
    success(process) || error("pomdpsol failed; its last words:\n" * join(last(log, 10), "\n"))
    return bounds, log
end

"Bounds from a line of the solver's table (time, trials, backups, lower, upper, …), or `nothing`."
function parse_bounds(line)
    numbers = tryparse.(Float64, split(line))
    (length(numbers) >= 6 && !any(isnothing, numbers)) || return nothing
    return (; seconds = numbers[1], lower = numbers[4], upper = numbers[5])
end

"Alpha vectors of the solver's policy file, as (visible value, action index, values over the joint hidden index)."
function read_policy(file, m)
    vectors = Tuple{Int,Int,Vector{Float64}}[]
    for found in eachmatch(r"<Vector action=\"(\d+)\" obsValue=\"(\d+)\">([^<]*)</Vector>", read(file, String))
        action, visible = parse(Int, found[1]) + 1, parse(Int, found[2]) + 1
        is_terminal_value(m, visible) && continue
        values = parse.(Float64, split(found[3]))
        length(values) == joint_size(m) ||
            error("$file: a vector of $(length(values)) values, the model has $(joint_size(m)) hidden states")
        push!(vectors, (visible, action, values))
    end
    isempty(vectors) && error("$file: no alpha vector found")
    return vectors
end
