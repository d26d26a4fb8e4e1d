"""Generate source code for the derivatives of a force from its source code.

This is forward-mode automatic differentiation (A. Griewank and A. Walther, Evaluating Derivatives, 2008, ch. 3): each
elementary function is evaluated once and used for the value and for all derivatives.
"""

from __future__ import annotations

import ast

SLOPES = {
    "sin": "math.cos({a})",
    "cos": "-math.sin({a})",
    "tan": "1.0 + {f} * {f}",
    "tanh": "1.0 - {f} * {f}",
    "exp": "{f}",
    "log": "1.0 / {a}",
    "sqrt": "0.5 / {f} if {f} != 0.0 else 0.0",
    "atan": "1.0 / (1.0 + {a} * {a})",
    "arctan": "1.0 / (1.0 + {a} * {a})",
    "sinh": "math.cosh({a})",
    "cosh": "math.sinh({a})",
    "abs": "1.0 if {a} >= 0.0 else -1.0",
    "fabs": "1.0 if {a} >= 0.0 else -1.0",
}
"""For each elementary function f(a), the source text of its derivative, in which {a} stands for the argument and {f}
for the value."""


class NoSlopeError(Exception):
    """Exception for a source that contains something that this module cannot differentiate."""


def derivative_source(source: str, name: str, seeds: list[str]) -> str:
    """Return the source of a function `name` that returns the value of a given function and its derivatives.

    source: source of the given function. seeds: variables by which it is differentiated: arguments, or items of an
    argument such as `p[0]`. The new function has the same arguments, then `_sizes`, which it does not use, and returns
    a tuple: the value, then one derivative for each seed. Raises NoSlopeError unless the given function consists of
    assignments to names and a return, in operations that this module knows.
    """
    function = ast.parse(source).body[0]
    assert isinstance(function, ast.FunctionDef)
    arguments = [a.arg for a in (*function.args.posonlyargs, *function.args.args)]
    lines = _Lines(seeds, arguments)
    for statement in function.body:
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            continue  # docstring
        match statement:
            case ast.Assign(targets=[ast.Name(id=target)]):
                lines.known[target] = lines.of(statement.value)
            case ast.Return(value=ast.expr() as value):
                returned_value, slopes = lines.of(value)
                returned = ", ".join([returned_value, *(slopes.get(seed, "0.0") for seed in seeds)])
                lines.text.append(f"return {returned}")
                body = "".join(f"    {line}\n" for line in lines.text)
                return f"@njit\ndef {name}({', '.join([*arguments, '_sizes'])}):\n{body}"
            case _:
                break
    raise NoSlopeError


class _Lines:
    """Builder of a function body in which each line is one operation on names and numbers.

    A value is represented by a pair: the text of its name or number, and a dictionary of the texts of its derivatives.
    The keys of the dictionary are the seeds, which are the variables of differentiation, on which the value depends.
    """

    def __init__(self, seeds: list[str], arguments: list[str]) -> None:
        self.text: list[str] = []
        self.seeds = seeds
        self.known = {a: (a, {a: "1.0"} if a in seeds else {}) for a in arguments}

    def of(self, node: ast.expr) -> tuple[str, dict[str, str]]:
        """Append lines that evaluate an expression; return the texts of its value and, by seed, of its derivatives.

        Raises NoSlopeError if the expression cannot be differentiated here.
        """
        match node:
            case ast.Constant(value=int() | float() as number):
                return repr(float(number)), {}
            case ast.Name(id=name) if name in self.known:
                return self.known[name]
            case ast.Subscript() if ast.unparse(node) in self.seeds:
                return ast.unparse(node), {ast.unparse(node): "1.0"}
            case ast.Attribute(value=ast.Name(id="math" | "np"), attr="pi"):
                return "math.pi", {}
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                value, slopes = self.of(inner)
                return self._new(f"-{value}"), self._chain([("-1.0", slopes)])
            case ast.BinOp(left=left, op=op, right=right):
                (a, by_a), (b, by_b) = self.of(left), self.of(right)
                match op:
                    case ast.Add():
                        return self._new(f"{a} + {b}"), self._chain([("1.0", by_a), ("1.0", by_b)])
                    case ast.Sub():
                        return self._new(f"{a} - {b}"), self._chain([("1.0", by_a), ("-1.0", by_b)])
                    case ast.Mult():
                        return self._new(f"{a} * {b}"), self._chain([(b, by_a), (a, by_b)])
                    case ast.Div():
                        f, over = self._new(f"{a} / {b}"), self._new(f"1.0 / {b}")
                        return f, self._chain([(over, by_a), (f"-{f} * {over}", by_b)])
                    case ast.Pow() if b == "2.0":
                        return self._new(f"{a} * {a}"), self._chain([(f"2.0 * {a}", by_a)])
                    case ast.Pow():
                        f = self._new(f"{a} ** {b}")
                        slope = f"{b} * {f} / {a} if {a} != 0.0 else 0.0"
                        if b.replace(".", "").isdigit():
                            slope = f"{b} * {a} ** ({b} - 1.0)"
                        by_power = f"{f} * math.log({a}) if {a} > 0.0 else 0.0"
                        return f, self._chain([(slope, by_a), (by_power, by_b)])
            case ast.Call(func=called, args=[_, *_] as given, keywords=[]):
                text, arguments = ast.unparse(called), [self.of(argument) for argument in given]
                name, (a, by_a) = text.split(".")[-1].lstrip("_"), arguments[0]
                f = self._new(f"{text}({', '.join(value for value, _ in arguments)})")
                if name in SLOPES and len(given) == 1:
                    return f, self._chain([(SLOPES[name].format(a=a, f=f), by_a)])
                if text in ("max", "min") and len(given) == 2:
                    first = self._new(f"1.0 if {f} == {a} else 0.0")
                    return f, self._chain([(first, by_a), (f"1.0 - {first}", arguments[1][1])])
        raise NoSlopeError

    def _new(self, text: str) -> str:
        name = f"_s{len(self.text)}"
        self.text.append(f"{name} = {text}")
        return name

    def _chain(self, parts: list[tuple[str, dict[str, str]]]) -> dict[str, str]:
        """Append the lines of the chain rule for one operation; return the texts of its derivatives, by seed.

        parts: for each argument of the operation, the text of the partial derivative of the result by it, and the
        derivatives of the argument by seed. The result is the sum of their products.
        """
        slopes_by_seed: dict[str, str] = {}
        for factor, slopes in parts:
            if not slopes:
                continue
            plain = factor if factor in ("1.0", "-1.0") or factor.isidentifier() else self._new(factor)
            for seed, slope in slopes.items():
                if "1.0" in (plain, slope):
                    term = slope if plain == "1.0" else plain
                else:
                    term = self._new(f"{plain} * {slope}")
                slopes_by_seed[seed] = (
                    self._new(f"{slopes_by_seed[seed]} + {term}") if seed in slopes_by_seed else term
                )
        return slopes_by_seed


def difference_source(call: str, arguments: list[str], steps: dict[str, str], name: str) -> str:
    """Return the source of a function `name` that returns a value and its derivatives by central differences.

    call: text of an expression that computes the value, with {} in the place of each variable of differentiation
    (seed). arguments: names of the arguments of the new function. steps: for each seed, in the order of `call`, the
    text of the step of its difference quotient. The function returns a tuple: the value, then one derivative for each
    seed.
    """
    seeds = list(steps)
    lines, returned = [], [call.format(*seeds)]
    for i, (seed, change) in enumerate(steps.items()):
        high, low = (call.format(*seeds[:i], f"{seed} {sign} _d{i}", *seeds[i + 1 :]) for sign in "+-")
        lines += [f"_d{i} = {change}", f"_slope{i} = ({high} - {low}) / (2.0 * _d{i})"]
        returned.append(f"_slope{i}")
    body = "".join(f"    {line}\n" for line in [*lines, f"return {', '.join(returned)}"])
    return f"@njit\ndef {name}({', '.join(arguments)}):\n{body}"
