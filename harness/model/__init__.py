"""A domain as arrays: names, tables, the compiled verbs on them, and the files that hold them."""
