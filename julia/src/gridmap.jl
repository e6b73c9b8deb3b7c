# Maps drawn in text: the cells that a robot may stand on, what marks them, and their neighbours.

const STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1))    # up, right, down, left as (row, column); row 1 is at the top

"""
    GridMap(lines)

A map of lines of text, the first at the top. Every character but a blank is a cell that can be stood on; cells are
numbered line by line from 1. `places` are their `(column, row)`, `marks` their characters.
"""
struct GridMap
    columns::Int
    rows::Int
    places::Vector{Tuple{Int,Int}}
    marks::Vector{Char}
    number::Matrix{Int}     # [row, column]: the cell there, 0 for a wall
end

function GridMap(lines)
    columns = maximum(length, lines)
    number = zeros(Int, length(lines), columns)
    places, marks = Tuple{Int,Int}[], Char[]
    for (row, line) in enumerate(lines), (column, mark) in enumerate(line)
        mark == ' ' && continue
        push!(places, (column, row))
        push!(marks, mark)
        number[row, column] = length(places)
    end
    return GridMap(columns, length(lines), places, marks, number)
end

ncells(g::GridMap) = length(g.places)

"Cells with one of the characters `marks`."
marked(g::GridMap, marks) = findall(in(marks), g.marks)

"The cell one step from `cell` in direction `d` (1 up, 2 right, 3 down, 4 left); 0 where a wall is."
function neighbour(g::GridMap, cell, d)
    column, row = g.places[cell]
    row, column = (row, column) .+ STEPS[d]
    return checkbounds(Bool, g.number, row, column) ? g.number[row, column] : 0
end

"""
What is needed to draw a map: its walls, `signs` (a `Char` in a cell each), and for the values of the one hidden factor the
cells that they stand for, where they stand for any.
"""
function grid_layout(g::GridMap; signs = Pair{Int,Char}[], hidden = Int[])
    walls = [[column, row] for row in 1:(g.rows) for column in 1:(g.columns) if g.number[row, column] == 0]
    return Dict{String,Any}(
        "kind" => "grid", "columns" => g.columns, "rows" => g.rows, "rows_grow" => "down", "walls" => walls,
        "signs" => [Any[string(sign), collect(g.places[cell])...] for (cell, sign) in signs],
        "hidden_cells" => [collect(g.places[cell]) for cell in hidden],
    )
end
