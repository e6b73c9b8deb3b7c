"""The program language: text, compiled form and interpreter, against a slow interpreter written from SPEC's words."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import harness
from harness.engine import rng
from harness.play.evaluation import evaluate
from harness.play.population import Episodes, play
from harness.policy.program import ProgramPolicy
from harness.program import ProgramError, parse, pieces, words_of
from tests import reference

# A program as nested tuples: ("do", action) | ("if", condition, then, otherwise or None) | ("while", condition, body);
# a condition: ("not", c) | ("and" | "or", c, c) | (quantity, comparison, value).

rocks = st.integers(1, 8)
# between the values that beliefs come back to (0, 1/2, 1), where the two sides' rounding would decide
thresholds = st.integers(0, 99).map(lambda n: (10 * n + 5) / 1000)
tests = st.one_of(
    st.tuples(st.builds("belief({})".format, rocks), st.sampled_from("<>"), thresholds),
    st.tuples(rocks.map(str), st.just("=="), st.sampled_from(["good", "bad"])),
    st.tuples(st.sampled_from(["x()", "y()"]), st.sampled_from(["<", ">", "=="]), st.integers(1, 7)),
    st.tuples(st.just("reading()"), st.just("=="), st.sampled_from(["none", "good", "bad"])),
)
conditions = st.recursive(
    tests,
    lambda inner: st.one_of(st.tuples(st.just("not"), inner), st.tuples(st.sampled_from(["and", "or"]), inner, inner)),
    max_leaves=4,
)
actions = st.sampled_from(reference.ACTIONS).map(lambda name: ("do", name))
statements = st.recursive(
    actions,
    lambda inner: st.one_of(
        st.tuples(st.just("if"), conditions, st.lists(inner, min_size=1, max_size=3).map(tuple), st.none()),
        st.tuples(
            st.just("if"),
            conditions,
            st.lists(inner, min_size=1, max_size=2).map(tuple),
            st.lists(inner, min_size=1, max_size=2).map(tuple),
        ),
        st.tuples(st.just("while"), conditions, st.lists(inner, min_size=1, max_size=2).map(tuple)),
    ),
    max_leaves=12,
)
programs = st.lists(statements, min_size=1, max_size=8).map(tuple)


def spell_condition(c, outer=0):
    if c[0] == "not":
        return f"not {spell_condition(c[1], 3)}"
    if c[0] in ("and", "or"):
        level = 1 if c[0] == "or" else 2
        text = f"{spell_condition(c[1], level)} {c[0]} {spell_condition(c[2], level + 0.5)}"
        return f"({text})" if outer > level else text
    value = f'"{c[2]}"' if isinstance(c[2], str) else str(c[2])
    return f"{c[0]} {c[1]} {value}"


def spell(block, blank="\n"):
    """Program text, with every body in braces."""
    parts = []
    for s in block:
        if s[0] == "do":
            parts.append(s[1])
        else:
            parts.append(f"{s[0]}({spell_condition(s[1])}) {{{blank}{spell(s[2], blank)}{blank}}}")
            if s[0] == "if" and s[3]:
                parts.append(f"else {{ {spell(s[3], blank)} }}")
    return blank.join(parts)


class Endless(Exception):
    pass


class SlowInterpreter:
    """Walks the tuples. What a policy sees of the world is handed in by :meth:`actions`."""

    def __init__(self):
        self.last = {}  # rock -> last reading of its check
        self.idle = 0

    def holds(self, c, world, beliefs):
        if c[0] == "not":
            return not self.holds(c[1], world, beliefs)
        if c[0] == "and":
            return self.holds(c[1], world, beliefs) and self.holds(c[2], world, beliefs)
        if c[0] == "or":
            return self.holds(c[1], world, beliefs) or self.holds(c[2], world, beliefs)
        quantity, sign, value = c
        if quantity.isdigit():
            return self.last.get(int(quantity)) == value
        if quantity == "reading()":
            return world.reading == value
        left = beliefs[int(quantity[7:-1]) - 1] if quantity.startswith("belief") else world.cell[quantity == "y()"]
        return {"<": left < value, ">": left > value, "==": left == value}[sign]

    def actions(self, block, world, beliefs):
        for s in block:
            self.idle += 1
            if self.idle > 500:
                raise Endless
            if s[0] == "do":
                self.idle = 0
                yield s[1]
                if s[1].startswith("check"):
                    self.last[int(s[1][6:-1])] = world.reading
            elif s[0] == "if":
                chosen = s[2] if self.holds(s[1], world, beliefs) else s[3] or ()
                yield from self.actions(chosen, world, beliefs)
            else:
                while self.holds(s[1], world, beliefs):
                    yield from self.actions(s[2], world, beliefs)
                    self.idle += 1
                    if self.idle > 500:
                        raise Endless


def slow_return(block, seed, episode, loop, horizon=50):
    world = reference.RockSample(rng.uniforms(seed, rng.ENGINE, 0, episode, 1)[0])
    belief = reference.BruteForceBelief()
    beliefs = belief.features()
    total, steps = 0.0, 0
    interpreter = SlowInterpreter()

    def forever():
        while True:
            yield from interpreter.actions(block, world, beliefs)
            interpreter.idle += 1
            if not loop or interpreter.idle > 500:
                return

    try:
        for action in forever():
            cell = world.cell
            steps += 1
            total += world.step(action, rng.uniforms(seed, rng.ENGINE, steps, episode, 1)[0])
            belief.update(cell, action, world.reading)
            beliefs[:] = belief.features()
            if world.done or steps == horizon:
                break
    except Endless:
        pass
    return total


@pytest.fixture(scope="module")
def words(rocksample):
    return words_of(rocksample)


@pytest.fixture(autouse=True)
def _short_repr(monkeypatch):
    """Hypothesis shows a failing test's arguments, and warns of long ones: what a domain is, its name says."""
    monkeypatch.setattr(harness.Domain, "__repr__", lambda self: self.name)


class TestInterpreter:
    @settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(block=programs, loop=st.booleans(), episode=st.integers(0, 10_000))
    def test_programs_do_what_the_language_says(self, rocksample, words, block, loop, episode):
        program = parse(spell(block), words, loop=loop)
        returns = play(rocksample, [program], Episodes(3, episode, 2, 50)).returns[0]
        assert returns.tolist() == [slow_return(block, 3, episode + k, loop) for k in range(2)]

    @settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(blocks=st.lists(programs, min_size=1, max_size=20), loop=st.booleans())
    def test_many_at_once_give_what_evaluate_gives(self, rocksample, words, blocks, loop):
        compiled = [parse(spell(block), words, loop=loop) for block in blocks]
        played = play(rocksample, compiled, Episodes(5, 0, 16, 30), workers=2)
        for program, returns, steps in zip(compiled, played.returns, played.steps, strict=True):
            result = evaluate(
                rocksample, ProgramPolicy(program), episodes=16, seed=5, horizon=30, engine="tables", workers=1
            )
            assert np.array_equal(result.returns, returns)
            assert result.steps.sum() == steps

    def test_hidden_bordercross_too(self, hidden):
        """There a first reading comes before the first step, and shaping changes rewards."""
        words = words_of(hidden)
        text = "if(distance() < 4) down(1) else right(2) while(distance() > 1) right(1) cooperate()"
        program = parse(text, words, loop=True)
        for domain in (hidden, hidden.shaped("potential")):
            returns = play(domain, [program], Episodes(1, 0, 200, 50)).returns[0]
            result = evaluate(domain, ProgramPolicy(program), episodes=200, seed=1, engine="tables")
            assert np.array_equal(result.returns, returns)
        # The shaping telescopes (no discount in it), so that only start and end of an episode tell them apart.
        assert np.unique(returns).size > 5

    def test_a_script_ends_the_episode_at_its_end(self, rocksample, words):
        result = evaluate(rocksample, ProgramPolicy(parse("up() up()", words)), episodes=9, engine="tables")
        assert result.steps.tolist() == [2] * 9
        assert not result.terminated.any()
        looped = evaluate(rocksample, ProgramPolicy(parse("loop right()", words)), episodes=9, engine="tables")
        assert looped.score.mean == 10
        assert looped.steps.tolist() == [7] * 9

    def test_a_script_that_never_acts_is_stopped(self, rocksample, words):
        for text in ('while(x() == 1) if(1 == "good") up()', 'loop if(1 == "good") up()'):
            result = evaluate(rocksample, ProgramPolicy(parse(text, words)), episodes=3, engine="tables")
            assert result.steps.tolist() == [0] * 3

    def test_a_thousand_instructions_are_allowed(self, rocksample, words):
        """Each test with its branch is two instructions: 499 of them and an operation fit, 500 and it do not."""
        for count, steps in ((499, 1), (500, 0)):
            text = 'if(1 == "good") up() ' * count + "right()"
            result = evaluate(rocksample, ProgramPolicy(parse(text, words)), episodes=2, engine="tables")
            assert result.steps.tolist() == [steps] * 2

    def test_looking_before_sampling_on_every_rock_earns_fifty(self, rocksample, words):
        """Closed form: 10 for leaving, 10·Binomial(8, 1/2) for rocks, as a reading at distance 0 is always right."""
        route, at, lines = [2, 1, 3, 6, 5, 8, 7, 4], (1, 4), []
        for rock in route:
            x, y = reference.ROCKS[rock - 1]
            lines += ["right()" if x > at[0] else "left()"] * abs(x - at[0])
            lines += ["up()" if y > at[1] else "down()"] * abs(y - at[1])
            lines += [f"check({rock})", f'if({rock} == "good") sample()']
            at = (x, y)
        result = evaluate(rocksample, ProgramPolicy(parse("\n".join([*lines, "right()"]), words)), engine="tables")
        good = (result.returns - 10) / 10
        assert set(good) <= set(range(9))
        assert abs(good.mean() - 4) < 4 * np.sqrt(2 / 10_000)
        assert good.var() == pytest.approx(2, abs=0.15)
        assert result.score.success_rate == 1


class TestText:
    @settings(max_examples=150, deadline=None)
    @given(block=programs, loop=st.booleans(), blank=st.sampled_from([" ", "\n", "\n  # a remark\n"]))
    def test_round_trip(self, words, block, loop, blank):
        program = parse(spell(block, blank), words, loop=loop)
        again = parse(program.text, words)
        assert again.text == program.text
        assert np.array_equal(again.code, program.code)
        assert again.loop == loop

    @settings(max_examples=100, deadline=None)
    @given(block=programs)
    def test_the_short_cut_by_pieces_changes_nothing(self, words, block):
        """A remark is never taken for a piece, so that the parser gets the whole text."""
        text = spell(block, "\n")
        assert np.array_equal(parse(text, words).code, parse(f"{text} # the end", words).code)

    def test_the_short_cut_is_taken_for_what_evolution_writes(self, words):
        text = 'loop while(x() < 3) right() if(not 3 == "good" and (x() < 2 or y() < 3)) { up() } else { down() }'
        assert pieces.short(text, words, lambda piece: parse(f"{piece} #", words).code.tobytes()) is not None

    @pytest.mark.parametrize(
        ("text", "shown", "length"),
        [
            ("check( 3 )", "check(3)", 1),
            ("if(belief(3)>0.74) sample()", "if(belief(3) > 0.74) sample()", 1),
            ("if (3==good) right() up()", 'if(3 == "good") right()\nup()', 2),
            ("if(x() < 3) { up() } else { down() up() }", "if(x() < 3) up()\nelse {\n    down()\n    up()\n}", 3),
            ("if(x() < 3) { up() up() } else down()", "if(x() < 3) {\n    up()\n    up()\n} else down()", 4),
            ("while(not(x() > 3 or y() > 2)) right()", "while(not (x() > 3 or y() > 2)) right()", 1),
            ("if(x() < 3) if(y() < 2) up() else down()", "if(x() < 3) {\n    if(y() < 2) up()\n    else down()\n}", 3),
            ("loop{up()down()}", "loop\nup()\ndown()", 2),
        ],
    )
    def test_the_canonical_form(self, words, text, shown, length):
        program = parse(text, words)
        assert program.text == shown + "\n"
        assert program.length == length

    def test_constants_can_be_replaced(self, words):
        program = parse("if(belief(3) > 0.74 and x() > 2) up() while(belief(1) < 0.5) check(1)", words)
        assert program.constants.tolist() == [0.74, 0.5]
        other = program.with_constants(np.array([0.8125, 0.25]))
        assert other.text == "if(belief(3) > 0.8125 and x() > 2) up()\nwhile(belief(1) < 0.25) check(1)\n"
        assert program.constants.tolist() == [0.74, 0.5]


class TestErrors:
    @pytest.mark.parametrize(
        ("text", "line", "column", "words_of_it"),
        [
            ("up()\nchek(3)", 2, 1, "did you mean 'check(3)'"),
            ("up() check(9)", 1, 6, "no operation 'check(9)'"),
            ("up()\n  right(", 2, 3, "'right'; operations are written with parentheses"),
            ("if(check(1)) up()", 1, 4, "is an operation"),
            ("if(belief(3) > good) up()", 1, 4, "compared with a number"),
            ("if(belief(3)) up()", 1, 4, "compare it"),
            ("belief(1) > 0.3", 1, 1, "is a condition"),
            ("up() {}", 1, 6, "the block is empty"),
            ("up()\n{ up()", 2, 1, "a '}' is missing"),
            ("up() $", 1, 6, "'$' cannot stand here"),
            ("if(1 > 2) up()", 1, 4, "compared by =="),
            ('if(1 == "god") up()', 1, 4, "did you mean 'good'"),
            ("else up()", 1, 1, "no 'if' before it"),
            ("up() loop", 1, 6, "first word"),
            ("loop", 1, 5, "no statement"),
            ("", 1, 1, "no statement"),
            ("while(x() > 2)", 1, 15, "not the end"),
            ("if(distance() < 3) up()", 1, 4, "no quantity 'distance()'"),
            ("if((x() > 2) up()", 1, 14, "')' is expected"),
            ("{" * 60 + "up()" + "}" * 60, 1, 52, "more than 50 deep"),
        ],
    )
    def test_name_line_and_column(self, words, text, line, column, words_of_it):
        with pytest.raises(ProgramError) as error:
            parse(text, words, source="my.txt")
        assert str(error.value).startswith(f"my.txt, line {line}, column {column}: ")
        assert words_of_it in str(error.value)
        assert "\n" not in str(error.value)

    @settings(max_examples=300, deadline=None)
    @given(st.text(alphabet="abchekupif(){}<>=0123. \n\"'#", max_size=60))
    def test_any_text_is_a_program_or_one_sentence(self, words, text):
        try:
            program = parse(text, words)
        except ProgramError as error:
            message = str(error)
        else:
            message = "program, line " if parse(program.text, words).text == program.text else "no round trip"
        assert message.startswith("program, line ")

    def test_on_the_command_line(self, tmp_path, capsys):
        from harness.cli import main

        path = tmp_path / "mine.txt"
        path.write_text("up()\nsampel()\n")
        assert main(["compare", "rocksample-7x8", "--policy", f"program:{path}", "--engine", "tables"]) == 2
        assert f"{path}, line 2, column 1" in capsys.readouterr().err
        assert main(["compare", "rocksample-7x8", "--policy", "program:/no/file"]) == 2
        assert "cannot read '/no/file'" in capsys.readouterr().err
        path.write_text("up()\nright()\n")
        table = harness.compare("rocksample-7x8", [f"program:{path}"], episodes=3, engine="tables")
        assert table["steps_mean"].tolist() == [2]


def test_a_policy_may_stop(rocksample):
    """STOP leaves an episode as it is: no steps, no reward, no success, whatever the others do."""

    class Half:
        def reset(self, batch):
            pass

        def act(self, batch):
            actions = np.full(batch.size, batch.domain.action("right()"))
            actions[::2] = -1
            return actions

    result = evaluate(rocksample, Half(), episodes=10, engine="tables", workers=1)
    assert result.returns.tolist() == [0, 10] * 5
    assert result.steps.tolist() == [0, 7] * 5
    assert result.terminated.tolist() == [False, True] * 5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("right()" + " " * 50_000 + "?", "column 50008: '\\?' cannot stand here"),
        ("right()" + " " * 50_000 + "else", "'else' has no 'if' before it"),
        ("a" * 100_000, "an operation, if, while or a block is expected here, not 'a{50}"),
        ("right(" * 20_000, "an operation, if, while or a block is expected here"),
        ("if(belief(1) > " + "9" * 5000 + ") right()", "compared with a number above 1e\\+09"),
        ("check(" + "1" * 5000 + ")", "knows no operation 'check"),
        ("\x1b[31mright()", r"'\\x1b' cannot stand here"),
        ('if(1 == "\x1b[31m") right()', r"knows no reading '\\x1b"),
    ],
)
def test_hostile_texts_are_refused_in_one_printable_sentence(rocksample, text, words):
    """Some of them took minutes: every place was looked at from every other."""
    with pytest.raises(ProgramError, match=words) as error:
        parse(text, words_of(rocksample))
    assert len(str(error.value)) < 300
    assert str(error.value).isprintable()


def test_a_long_comment_and_long_blanks_are_nothing(rocksample):
    words = words_of(rocksample)
    text = "right()\n#" + "x" * 50_000 + "\n" + " " * 50_000 + "up()" + "\n" * 50_000
    assert parse(text, words).text == "right()\nup()\n"
    assert parse("# no statement but this:\nup()", words).text == "up()\n"


def test_registers_follow_the_names_of_the_checks(rocksample):
    """check(01) is a name like any other, and keeps its own reading."""
    from dataclasses import replace

    odd = replace(rocksample, actions=(*rocksample.actions[:-1], "check(08)"))
    words = words_of(odd)
    assert words.checks["08"] == words.register[-1] == 7
    assert parse('if(08 == "good") check(08)', words).text == 'if(08 == "good") check(08)\n'
