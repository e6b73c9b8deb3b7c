"""Grammatical evolution: grammars, mapping, initialisation, operators, and runs that can be stopped and resumed."""
