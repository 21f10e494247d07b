"""Arithmetic of function files: values by hand, by `rcalc`, and what is refused."""

import numpy as np
import pytest

from drcmitsuba.model.radiance.expression import ExpressionError, definitions, value
from tests import radiance, skips

EXPRESSIONS = [
    "-2^2", "2^3^2", "2-3-4", "8/4/2", "2*-3", "+2", "2^-1", "-2*3", "1e3+.5-5.", "1.e-2",
    "if(0,1,2)", "if(1e-9,1,2)", "min(1,2)+max(3,4)", "log10(100)+log(2)", "PI", "atan2(1,-2)",
    "floor(-1.5)+ceil(1.2)", "sqrt(2)*exp(.3)", "sin(1)+cos(1)+tan(1)", "asin(.3)+acos(.3)+atan(3)",
    "(1+2)*(3-(4/5))", "((((1))))", "0^0",
]  # fmt: skip


@skips.RADIANCE.mark
@pytest.mark.parametrize("text", EXPRESSIONS)
def test_expressions_have_the_value_that_rcalc_gives(text, tmp_path):
    output = radiance.run(["rcalc", "-n", "-e", f"$1={text}"], tmp_path)
    assert float(value(text, {})) == pytest.approx(float(output), rel=1e-7)


def test_definitions_serve_each_other_and_arrays_pass_through():
    known = definitions("f(x,y)=x*g+y; g:2;h = f(s,1)")
    s = np.array([0.0, 1, 2])
    np.testing.assert_allclose(value("h+s^2", {"s": s}, known), [1, 4, 9])
    np.testing.assert_allclose(value("if(s-.5,1/s,0)", {"s": s}), [0, 1, 0.5])
    np.testing.assert_allclose(value("bound(.5,s,1.5)", {"s": s}), [0.5, 1, 1.5])
    assert float(value("A2+arg(1)+abs(-3)+mod(5,3)", {"A1": 1.0, "A2": 10.0})) == 16
    assert float(value("mod(-5,3)+10*mod(5,-3)", {})) == 1 - 10  # as `rayinit.cal` has it


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "an operand is missing"),
        ("1+", "an operand is missing"),
        ("(1", "')' is missing"),
        ("2 3", "where an operator is due"),
        ("--2", "an operand is missing"),
        ("1;2", "';2'"),
        ("__import__('os')", 'in "__import__'),
        ("os.system(1)", "unknown function 'os.system'"),
        ("x", "unknown name 'x'"),
        ("noise3(1,2,3)", "unknown function 'noise3'"),
        ("sin(1,2)", "'sin' with 2 arguments"),
        ("sin", "'sin' with 0 arguments"),
        ("arg(1)", "'arg' with 1 arguments"),
        ("(" * 50 + "1" + ")" * 50, "parentheses deep"),
        ("1" + "+1" * 6000, "characters"),
        ("1" + "+1" * 4000, "too many steps"),
        ("^".join("2" * 900), "too many steps"),
    ],
)
def test_what_is_no_expression_is_refused(text, complaint):
    with pytest.raises(ExpressionError) as error:
        value(text, {})
    assert complaint in str(error.value)


def test_comments_stand_in_braces_and_parameters_are_those_of_their_function():
    """A caller's parameter `a` hides no definition of that name from what it calls."""
    known = definitions("{ one; {two} }\na = 8; g = a;{}f(a) = a + g;")
    assert float(value("f(1)", {}, known)) == 9
    for text in ("{ a = 1;", "a = 1; }"):
        with pytest.raises(ExpressionError, match="no partner"):
            definitions(text)


@pytest.mark.parametrize("text", ["f=f", "f=g;g=f", "f=if(1,0,f)", "f=h(1);h(x)=h(x-1)"])
def test_definitions_without_end_are_refused(text):
    with pytest.raises(ExpressionError, match="do its definitions call themselves"):
        value("f", {}, definitions(text))


def test_definitions_that_multiply_end_soon():
    known = definitions("a0=1;" + ";".join(f"a{i + 1}=a{i}+a{i}" for i in range(30)))
    with pytest.raises(ExpressionError, match="too many steps"):
        value("a30", {}, known)
    with pytest.raises(ExpressionError, match="no definition"):
        definitions("1=2")
