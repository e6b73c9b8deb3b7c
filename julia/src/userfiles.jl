# Julia files of the user's own: a model, a policy or a solver is what their last expression gives.

"""
    run_file(scope, file)

The value of the last expression of `file`, run in the module `scope`. Random numbers that the file draws are the same
at every run. Throws an `ArgumentError` that names file and line where something in it fails.
"""
function run_file(scope::Module, file::AbstractString)
    Random.seed!(0)
    return in_file(() -> Base.include(scope, file), file)
end

"What `body()` returns; what it throws becomes one sentence that names `file`, and the line of it where there is one."
function in_file(body, file)
    try
        return body()
    catch error
        error isa InterruptException && rethrow()
        throw(ArgumentError(told(file, error, stacktrace(catch_backtrace()))))
    end
end

function told(file, error, trace)
    error isa LoadError && return told(error.file, error.error, error.line)
    line = line_of(trace, file)
    return "$(basename(file))$(line > 0 ? ", line $line" : ""): $(reason(error))"
end
told(file, error, line::Integer) =
    error isa LoadError ? told(error.file, error, nothing) : "$(basename(file)), line $line: $(reason(error))"

"The line of `file` that was being run; 0 where the trace does not come by it."
function line_of(trace, file)
    i = findfirst(frame -> basename(string(frame.file)) == basename(file), something(trace, []))
    return i === nothing ? 0 : trace[i].line
end

"What went wrong, as one line; for a package that is not there, how to get it."
function reason(error)
    text = sprint(showerror, error)
    missing_package = match(r"^ArgumentError: Package (\w+) .*not found", text)
    if missing_package !== nothing
        name = missing_package[1]
        return "Julia package $name is not installed: julia --project=$(dirname(Base.active_project())) " *
               "-e 'using Pkg; Pkg.add(\"$name\")'"
    end
    return replace(first(split(text, '\n')), r"^ArgumentError: " => "")
end
