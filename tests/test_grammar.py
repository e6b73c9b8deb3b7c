"""Grammars and mapping, against derivations worked out by hand and a mapper that rewrites text."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import harness
from harness import registry
from harness.ge import grammar as bnf
from harness.ge import initialisation
from harness.ge.fitness import check_language
from harness.ge.grammar import GrammarError
from harness.ge.initialisation import FULL, GROW, POSITION_INDEPENDENT, tree
from harness.ge.mapping import derive
from harness.program import parse, words_of

EXPRESSION = """
<expr> ::= <expr> <op> <expr> | (<expr>) | <var>   # three alternatives
<op>   ::= + | "-"
<var>  ::= x
"""
PAPER = ["rocksample", "bordercross"]
SHIPPED = [*PAPER, "rocksample-feedback", "rocksample-const"]


def shipped(name):
    return bnf.read(registry.grammar_path(name))


codons = st.lists(st.integers(0, 999), min_size=1, max_size=60).map(lambda c: np.array(c, dtype=np.int32))


def rewrite(grammar_text, codons, max_wraps):
    """A mapper that knows nothing but the text: it rewrites the leftmost <name> until there is none."""
    rules = {}
    for line in re.sub(r"#.*", "", grammar_text).strip().splitlines():
        name, body = line.split("::=")
        rules[name.strip()] = [part.strip().replace('"', "") for part in body.split("|")]
    text, used = next(iter(rules)), 0
    while (match := re.search(r"<[^<>|\s]+>", text)) is not None:
        choices = rules[match.group()]
        pick = 0
        if len(choices) > 1:
            if used == len(codons) * (max_wraps + 1):
                return None, used
            pick = codons[used % len(codons)] % len(choices)
            used += 1
        text = text[: match.start()] + choices[pick] + text[match.end() :]
    return text, used


class TestMapping:
    def test_a_derivation_worked_out_on_paper(self):
        """expr →(3: 0) expr op expr →(5: 2) var op expr → x op expr →(7: 1) x - expr →(1) x - (expr) →(8: 2) x - (x)"""
        derivation = derive(bnf.parse(EXPRESSION), np.array([3, 5, 7, 1, 8, 4], dtype=np.int32))
        assert derivation.phenotype == "x - (x)"
        assert derivation.used == 5  # <var> has one production and takes no codon
        assert derivation.depth == 4
        # expr(0-5) expr(1-2) var op(2-3) expr(3-5) expr(4-5) var
        assert derivation.nodes[:, 1:].tolist() == [[0, 5], [1, 2], [2, 2], [2, 3], [3, 5], [4, 5], [5, 5]]
        assert derivation.nodes[:, 0].tolist() == [0, 0, 2, 1, 0, 0, 2]

    @pytest.mark.parametrize(("wraps", "phenotype", "used"), [(0, None, 2), (1, "x + x", 4), (5, "x + x", 4)])
    def test_wrapping_reads_the_codons_again(self, wraps, phenotype, used):
        """[0 2] gives expr op expr, x op expr; then 0: +, and 2: x."""
        derivation = derive(bnf.parse(EXPRESSION), np.array([0, 2], dtype=np.int32), wraps)
        assert (derivation.phenotype, derivation.used) == (phenotype, used)

    @settings(max_examples=300, deadline=None)
    @given(codons=codons, wraps=st.integers(0, 3))
    def test_it_agrees_with_rewriting_text(self, codons, wraps):
        derivation = derive(bnf.parse(EXPRESSION), codons, wraps)
        assert (derivation.phenotype, derivation.used) == rewrite(EXPRESSION, codons.tolist(), wraps)

    @settings(max_examples=100, deadline=None)
    @given(codons=codons, wraps=st.integers(0, 3), name=st.sampled_from(SHIPPED))
    def test_it_always_ends_and_always_the_same(self, codons, wraps, name):
        grammar = shipped(name)
        once, again = derive(grammar, codons, wraps), derive(grammar, codons.copy(), wraps)
        assert once.phenotype == again.phenotype
        assert once.used == again.used <= len(codons) * (wraps + 1)
        if once.phenotype is not None:
            assert not re.search(r"<[a-z]", once.phenotype)

    @settings(max_examples=100, deadline=None)
    @given(codons=codons, name=st.sampled_from(SHIPPED))
    def test_phenotypes_are_programs(self, codons, name):
        domain = harness.load("bordercross-7x8" if name == "bordercross" else "rocksample-7x8")
        phenotype = derive(shipped(name), codons).phenotype
        if phenotype is not None:
            assert parse(phenotype, words_of(domain)).length >= 1

    def test_a_constant_is_a_thousandth_of_its_codon(self):
        grammar = bnf.parse("<line> ::= if(belief(3) > <const>) up() | if(belief(3) '<' <const>) up()\n")
        for codon, number in ((0, "0.000"), (74, "0.074"), (999, "0.999"), (1500, "0.500")):
            derivation = derive(grammar, np.array([2, codon], dtype=np.int32))
            assert derivation.phenotype == f"if(belief(3) > {number}) up()"
            assert derivation.used == 2

    def test_a_rule_of_its_own_comes_before_the_built_in_one(self):
        grammar = bnf.parse("<line> ::= if(belief(3) > <const>) up()\n<const> ::= 0.5\n")
        assert derive(grammar, np.array([7], dtype=np.int32)).phenotype == "if(belief(3) > 0.5) up()"

    def test_the_paper_s_example_lines_can_be_derived(self):
        """`if(belief(3) > 0.74) sample()` takes the codons that its nine choices name."""
        chosen = [0, 0, 1, 2, 7, 4, 4]  # <code>, <expr>, <condition>, <rock>, <number>, <number>, <op>
        phenotype = derive(shipped("rocksample"), np.array(chosen, dtype=np.int32)).phenotype
        assert phenotype == "if(belief(3) > 0.74) sample()"


class TestInitialisation:
    @settings(max_examples=80, deadline=None)
    @given(
        name=st.sampled_from(SHIPPED),
        method=st.sampled_from([GROW, FULL, POSITION_INDEPENDENT]),
        depth=st.integers(1, 20),
        seed=st.integers(0, 2**32),
    )
    def test_trees_map_to_themselves_within_their_depth(self, name, method, depth, seed):
        grammar = shipped(name)
        made = tree(grammar, 0, depth, method, 1000, np.random.default_rng(seed))
        derivation = derive(grammar, made)
        least = int(grammar.arrays.depth[: grammar.arrays.rule_first[1]].min())
        assert derivation.phenotype is not None
        assert derivation.used == len(made)
        assert derivation.depth <= max(depth, least)
        assert ((made >= 0) & (made < 1000)).all()
        if method == FULL and name in PAPER:  # lists: only they recur, so a full tree is exactly full
            assert derivation.depth in (max(depth, least), max(depth, least) - 1)
        if method == POSITION_INDEPENDENT and depth > 8 and name in PAPER:
            assert derivation.depth >= depth - 3

    @pytest.mark.parametrize("method", sorted(initialisation.METHODS))
    def test_a_population_is_varied_and_reproducible(self, method):
        grammar, make = shipped("rocksample"), initialisation.METHODS[method]
        first, again, other = (make(grammar, 50, 30, 1000, 0.5, np.random.default_rng(s)) for s in (1, 1, 2))
        assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
        assert any(not np.array_equal(a, b) for a, b in zip(first, other, strict=True))
        phenotypes = {derive(grammar, c).phenotype for c in first}
        assert len(phenotypes) > (20 if method != "uniform" else 1)

    def test_ramped_depths_rise(self):
        grammar = shipped("rocksample")
        population = initialisation.ramped(grammar, 200, 40, 1000, 0.0, np.random.default_rng(0))
        full = [derive(grammar, c).depth for c in population[1::2]]
        assert full == sorted(full)
        assert full[-1] == 40

    @pytest.mark.parametrize("method", [GROW, FULL, POSITION_INDEPENDENT])
    def test_trees_that_double_stay_within_their_size(self, method):
        """A full tree of 50 levels would have 2^50 leaves."""
        grammar = bnf.parse("<code> ::= <code> <code> | right()")
        made = [tree(grammar, 0, 50, method, 1000, np.random.default_rng(seed)) for seed in range(20)]
        sizes = [len(derive(grammar, codons).nodes) for codons in made]
        assert max(sizes) <= bnf.LARGEST_TREE
        if method == FULL:
            assert min(sizes) >= bnf.LARGEST_TREE - 2

    @pytest.mark.parametrize(("levels", "what"), [(60, "no finite derivation"), (14, "no derivation of under 10,000")])
    def test_rules_that_only_double_are_refused(self, levels, what):
        doubling = "".join(f"<r{i}> ::= <r{i + 1}> <r{i + 1}>\n" for i in range(levels))
        with pytest.raises(GrammarError, match=f"line 2, .*<r0> has {what}"):
            bnf.parse(f"<code> ::= right() | <r0>\n{doubling}<r{levels}> ::= right() | left()\n")

    def test_a_derivation_that_grows_without_codons_is_invalid(self):
        """Rules with one production take no codon: 8,191 non-terminals come of each codon here."""
        doubling = "".join(f"<r{i}> ::= <r{i + 1}> <r{i + 1}>\n" for i in range(12))
        grammar = bnf.parse(f"<code> ::= x | <r0> <code>\n{doubling}<r12> ::= y\n")
        assert derive(grammar, np.array([1] * 300 + [0], dtype=np.int32)).phenotype is None
        assert derive(grammar, np.array([1, 0], dtype=np.int32)).phenotype == "y " * 4096 + "x"

    def test_a_production_longer_than_the_codons_stays_within_its_arrays(self):
        """It was written past the end of the stack, which ended Python sooner or later."""
        grammar = bnf.parse("<code> ::= <op> " + "<op> " * 5000 + "\n<op> ::= up() | down()")
        for _ in range(20):
            assert derive(grammar, np.zeros(1, dtype=np.int32), 6000).phenotype == " ".join(["up()"] * 5001)

    def test_a_phenotype_of_long_terminals_is_invalid(self):
        grammar = bnf.parse(f"<a> ::= {'x' * 500_000} <a> | y")
        assert derive(grammar, np.zeros(30, dtype=np.int32)).phenotype is None
        short = derive(grammar, np.array([0, 0, 1], dtype=np.int32)).phenotype
        assert short is not None
        assert len(short) == 1_000_003


class TestReader:
    def test_the_usual_dialect(self):
        text = '# a remark\n<a> ::= one  two <b> # more\n   | \'it is "x"\'\n\n<b> ::= "<" | < | "" | p\n  q\n'
        grammar = bnf.parse(text)
        assert grammar.rules == ("<a>", "<b>")
        spelled = [[grammar.terminals[~s] if s < 0 else s for s in p.symbols] for p in grammar.productions]
        assert spelled == [["one two ", 1], ['it is "x"'], ["<"], ["<"], [""], ["p q"]]
        assert [p.line for p in grammar.productions] == [2, 3, 5, 5, 5, 5]

    @pytest.mark.parametrize(
        ("text", "line", "column", "words"),
        [
            ("<a> ::= x\n  | <bb> y\n<b> ::= z", 2, 5, "<bb> is not defined; did you mean '<b>'?"),
            ("<a> ::= x\n<b> ::= z", 2, 1, "cannot be reached"),
            ("<a> ::= x | <b>\n<b> ::= <b> y", 2, 1, "no finite derivation"),
            ("<a> ::= <a>", 1, 1, "no finite derivation"),
            ("what\n<a> ::= x", 1, 1, "before the first rule"),
            ("<a> ::= x\n<a> ::= y", 2, 1, "defined in line 1 already"),
            ("<a> ::= x |\n", 1, 1, "empty alternative"),
            ("<a> ::= 'x", 1, 9, "the quote ' is not closed"),
            ("<a> ::= x <b y", 1, 11, "'<b' is not closed"),
            ("<a> ::= x ::= y", 1, 11, "'::=' without a <name>"),
            ("\n\n", 3, 1, "there is no rule"),
        ],
    )
    def test_faults_are_named_with_their_place(self, text, line, column, words):
        with pytest.raises(GrammarError) as error:
            bnf.parse(text, "my.bnf")
        assert str(error.value).startswith(f"my.bnf, line {line}, column {column}: ")
        assert words in str(error.value)

    @settings(max_examples=300, deadline=None)
    @given(st.text(alphabet="<>ab:=| '\"#\n", max_size=50))
    def test_any_text_is_a_grammar_or_one_sentence(self, text):
        try:
            grammar = bnf.parse(text)
        except GrammarError as error:
            message = str(error)
        else:
            made = tree(grammar, 0, 5, GROW, 100, np.random.default_rng(0))
            message = "grammar, line " if derive(grammar, made).phenotype is not None else "no sentence"
        assert message.startswith("grammar, line ")

    def test_depths_and_recursion(self):
        arrays = bnf.parse(EXPRESSION).arrays
        assert arrays.depth.tolist() == [3, 3, 2, 1, 1, 1]
        assert arrays.recursive.tolist() == [True, True, False, False, False, False]

    @settings(max_examples=200, deadline=None)
    @given(st.lists(st.lists(st.lists(st.integers(-1, 5), max_size=3), min_size=1, max_size=3), min_size=1, max_size=6))
    def test_depths_sizes_and_recursion_against_slow_ways(self, rules):
        """Rounds over all productions until nothing changes; a search for a way back from every symbol."""
        rules = [[[s for s in p if s < len(rules)] for p in alternatives] for alternatives in rules]
        productions = [(r, p) for r, alternatives in enumerate(rules) for p in alternatives]
        depth, size = [np.inf] * len(rules), [np.inf] * len(rules)
        for _ in range(len(productions) + 1):
            for r, p in productions:
                depth[r] = min(depth[r], 1 + max((depth[s] for s in p if s >= 0), default=0))
                size[r] = min(size[r], 1 + sum(size[s] for s in p if s >= 0))

        def leads(s, goal, seen):
            if s == goal:
                return True
            new = {t for p in rules[s] for t in p if t >= 0} - seen
            return any(leads(t, goal, seen | new) for t in new)

        names = [f"<r{i}>" for i in range(len(rules))]
        spelled = [[bnf.Production(r, tuple(p), 1)] for r, p in productions]
        grammar = bnf.Grammar("g", "", tuple(names), ("x",), tuple(p for each in spelled for p in each))
        for i, (r, p) in enumerate(productions):
            symbols = [s for s in p if s >= 0]
            expected = 1 + max((depth[s] for s in symbols), default=0), 1 + sum(size[s] for s in symbols)
            found = [np.inf if n >= bnf.ENDLESS else n for n in (grammar._depths[i], grammar._sizes[i])]
            assert tuple(found) == expected
            assert grammar._recursive[i] == any(leads(s, r, {s}) for s in symbols)

    def test_too_many_alternatives_are_refused(self):
        text = "<a> ::= " + " | ".join(["x"] * (bnf.MOST_PRODUCTIONS + 1))
        with pytest.raises(GrammarError, match="10,001 alternatives; a grammar has 10,000 at most"):
            bnf.parse(text)

    def test_a_long_chain_of_rules_is_a_grammar(self, rocksample):
        """Far deeper than Python calls itself."""
        chain = "".join(f"<r{i}> ::= <r{i + 1}>\n" for i in range(1500)) + "<r1500> ::= up() | jump()\n"
        with pytest.raises(GrammarError, match=r"line 1501: .*'jump\(\)'"):
            check_language(bnf.parse(chain, "my.bnf"), words_of(rocksample))

    @pytest.mark.parametrize(("alternative", "most"), [("", 0), (" | up()", 1_000_000), (" | up() <r0>", 1_000_000)])
    def test_the_work_of_checking_a_chain_has_an_end(self, rocksample, monkeypatch, alternative, most):
        """Trees from each of 3,000 rules down have 4.5 million rules, at each of three depths."""
        derived = []

        def counted(*args, **options):
            made = derive(*args, **options)
            derived.append(len(made.nodes))
            return made

        monkeypatch.setattr("harness.ge.fitness.derive", counted)
        chain = "".join(f"<r{i}> ::= <r{i + 1}>{alternative}\n" for i in range(3000)) + "<r3000> ::= up()\n"
        check_language(bnf.parse(chain), words_of(rocksample))
        assert sum(derived) - max(derived, default=0) <= most
        assert bool(derived) == bool(most)

    def test_what_stands_around_far_rules_has_an_end(self, rocksample, monkeypatch):
        monkeypatch.setattr("harness.ge.fitness._MOST_AROUND", 500)
        chain = (
            "".join(f"<r{i}> ::= if(belief(1) > 0.5) <r{i + 1}> | up()\n" for i in range(100)) + "<r100> ::= jump()\n"
        )
        check_language(bnf.parse(chain), words_of(rocksample))  # too far away to be tried
        with pytest.raises(GrammarError, match="is no program"):
            check_language(bnf.parse(chain.replace("<r9> | up()", "<r9> | jump()")), words_of(rocksample))

    def test_a_text_without_end_is_not_read_on(self, tmp_path):
        (tmp_path / "long.bnf").write_text("#" * (2**20 + 1))
        with pytest.raises(GrammarError, match=r"long\.bnf.: it is longer than 1,048,576 bytes"):
            bnf.read(tmp_path / "long.bnf")
        with pytest.raises(harness.HarnessError, match="/dev/zero': it is longer"):
            harness.evaluate("rocksample-7x8", "program:/dev/zero", episodes=1)

    def test_a_grammar_of_another_language_is_refused(self, rocksample):
        text = "<code> ::= <line> | <code> <line>\n<line> ::= up() | jump()\n"
        with pytest.raises(GrammarError, match=r"my\.bnf, line 2: .*'jump\(\)'.* is no program of rocksample-7x8"):
            check_language(bnf.parse(text, "my.bnf"), words_of(rocksample))

    @pytest.mark.parametrize("name", SHIPPED)
    def test_shipped_grammars_speak_their_language(self, name):
        domain = harness.load("bordercross-7x8" if name == "bordercross" else "rocksample-7x8")
        check_language(shipped(name), words_of(domain))

    @pytest.mark.parametrize("name", ["rocksample-11x11", "bordercross-7x8-random"])
    def test_other_domains_get_a_grammar_of_their_words(self, name):
        from harness.ge.defaults import grammar_for

        domain = harness.load(name)
        grammar = grammar_for(domain, None)
        check_language(grammar, words_of(domain))
        if name == "rocksample-11x11":
            assert {"check(11)", "belief(11)"} <= {t.strip() for t in grammar.terminals}
