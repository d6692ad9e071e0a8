"""The syntax tree of the textual languages. Trees are values; passes never change them."""

from __future__ import annotations

from dataclasses import dataclass

from plcemu.base.spans import Span

# ---------------------------------------------------------------- expressions


@dataclass(frozen=True, slots=True, eq=False)
class Literal:
    """A literal; `type` is the type written with it, or empty."""

    span: Span
    kind: str
    value: int | float | str | bool
    type: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Name:
    """A variable, perhaps with fields, subscripts and a bit: `a[i].Q` is ("a", (i,), "Q").

    `w.3` and `w.%X3` are ("w", 3).
    """

    span: Span
    parts: tuple[str | int | tuple[Expr, ...], ...]

    @property
    def head(self) -> str:
        """The first part, which is always a name."""
        assert isinstance(self.parts[0], str)
        return self.parts[0]

    def __str__(self) -> str:
        return "".join("[...]" if isinstance(p, tuple) else f".{p}" for p in self.parts)[1:]


@dataclass(frozen=True, slots=True, eq=False)
class Direct:
    """A directly represented variable such as `%IX0.0`."""

    span: Span
    address: str


@dataclass(frozen=True, slots=True, eq=False)
class Unary:
    """`NOT x` or `-x`."""

    span: Span
    op: str
    operand: Expr


@dataclass(frozen=True, slots=True, eq=False)
class Binary:
    """An operator between two operands; `op` is the IL operator's name, such as `AND` or `GE`."""

    span: Span
    op: str
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True, eq=False)
class Evaluate:
    """The value of a transition's condition, a function of its own (made by SFC lowering)."""

    span: Span
    function: str


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """A call of a function, with its value."""

    span: Span
    name: str
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Nested:
    """What IL instructions in parentheses leave: an argument of a formal call in IL (annex B.2)."""

    span: Span
    instructions: tuple[Instruction, ...]


Expr = Literal | Name | Direct | Unary | Binary | Call | Evaluate | Nested


@dataclass(frozen=True, slots=True, eq=False)
class Argument:
    """An argument of a call: `x`, `IN := x`, `Q => x` or `NOT Q => x`."""

    span: Span
    name: str
    value: Expr
    is_output: bool = False
    negated: bool = False


# ---------------------------------------------------------------- statements


@dataclass(frozen=True, slots=True, eq=False)
class Assign:
    """`target := value`."""

    span: Span
    target: Name | Direct
    value: Expr


@dataclass(frozen=True, slots=True, eq=False)
class Invoke:
    """A call of a function block instance."""

    span: Span
    instance: Name
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RunAction:
    """A run of an action's body (made by SFC lowering)."""

    span: Span
    function: str


@dataclass(frozen=True, slots=True, eq=False)
class If:
    """IF and ELSIF branches as (condition, body), and the ELSE body."""

    span: Span
    branches: tuple[tuple[Expr, tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """CASE: each branch has (low, high) ranges of constants and a body."""

    span: Span
    selector: Expr
    branches: tuple[tuple[tuple[tuple[Expr, Expr], ...], tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class For:
    """FOR control := first TO last BY step."""

    span: Span
    control: Name
    first: Expr
    last: Expr
    step: Expr | None
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True, eq=False)
class While:
    """WHILE condition DO body."""

    span: Span
    condition: Expr
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Repeat:
    """REPEAT body UNTIL condition."""

    span: Span
    body: tuple[Statement, ...]
    condition: Expr


@dataclass(frozen=True, slots=True, eq=False)
class Exit:
    """EXIT: leave the innermost loop; or CONTINUE: leave just this round of it."""

    span: Span
    goes_on: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Return:
    """RETURN: leave the POU."""

    span: Span


Statement = Assign | Invoke | RunAction | If | Case | For | While | Repeat | Exit | Return


# ---------------------------------------------------------------- bodies


@dataclass(frozen=True, slots=True, eq=False)
class Instruction:
    """One IL instruction.

    Attributes:
        label: before it, or empty.
        op: the operator without modifiers; empty for a label alone. `FUNCTION` calls a function
            with the current result as its first argument, `FUNCTION(` one with all its arguments
            in parentheses, `INPUT` gives the current result to an input of a function block.
        negated: modifier N on the operand or, for jumps and calls, on the condition.
        conditional: modifier C.
        operand: the operand, if any; of a call the name of what is called.
        nested: the instructions between parentheses, or None.
        arguments: of a call; of INPUT one, whose name is the input's.
    """

    span: Span
    label: str
    op: str
    negated: bool = False
    conditional: bool = False
    operand: Expr | None = None
    nested: tuple[Instruction, ...] | None = None
    arguments: tuple[Argument, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class IlBody:
    """A body in Instruction List."""

    span: Span
    instructions: tuple[Instruction, ...]


@dataclass(frozen=True, slots=True, eq=False)
class StBody:
    """A body in Structured Text."""

    span: Span
    statements: tuple[Statement, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Association:
    """An action block of a step: which action, with which qualifier and time.

    Attributes:
        action: its name, or the text of the BOOL variable that it is.
        indicators: BOOL variables that tell the reader of the chart how the action went.
        variable: what `action` is if it is more than a plain name.
    """

    span: Span
    action: str
    qualifier: str
    time: Expr | None = None
    indicators: tuple[Name | Direct, ...] = ()
    variable: Name | Direct | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A step."""

    span: Span
    name: str
    initial: bool
    associations: tuple[Association, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Transition:
    """A transition; its condition is an ST expression or an IL body.

    Without a condition it takes the one declared under its name; without sources and targets it is
    such a declaration.
    """

    span: Span
    name: str
    priority: int | None
    sources: tuple[Name, ...]
    targets: tuple[Name, ...]
    condition: Expr | IlBody | None


@dataclass(frozen=True, slots=True, eq=False)
class Action:
    """A named action with a body in IL or ST."""

    span: Span
    name: str
    body: IlBody | StBody


@dataclass(frozen=True, slots=True, eq=False)
class SfcBody:
    """A body in Sequential Function Chart; `conditions` are those declared by name alone."""

    span: Span
    steps: tuple[Step, ...]
    transitions: tuple[Transition, ...]
    actions: tuple[Action, ...]
    conditions: tuple[Transition, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class NetOutput:
    """The value that a marked place gives to an output."""

    span: Span
    target: Name | Direct
    value: bool


@dataclass(frozen=True, slots=True, eq=False)
class NetPlace:
    """A place of a Signal Interpreted Petri Net; an initial one is marked at a cold start."""

    span: Span
    name: str
    initial: bool
    outputs: tuple[NetOutput, ...]


@dataclass(frozen=True, slots=True, eq=False)
class NetTransition:
    """A transition of a Signal Interpreted Petri Net: pre-places, post-places, firing condition."""

    span: Span
    name: str
    sources: tuple[Name, ...]
    targets: tuple[Name, ...]
    condition: Expr


@dataclass(frozen=True, slots=True, eq=False)
class SipnBody:
    """A body that is a Signal Interpreted Petri Net."""

    span: Span
    places: tuple[NetPlace, ...]
    transitions: tuple[NetTransition, ...]


Body = IlBody | StBody | SfcBody | SipnBody


# ---------------------------------------------------------------- declarations


@dataclass(frozen=True, slots=True, eq=False)
class NamedType:
    """A type by its name."""

    span: Span
    name: str


@dataclass(frozen=True, slots=True, eq=False)
class StringSpec:
    """`STRING[n]` or `WSTRING[n]`; without a length it is the standard's default."""

    span: Span
    wide: bool
    length: Expr | None


@dataclass(frozen=True, slots=True, eq=False)
class SubrangeSpec:
    """`INT (low .. high)`."""

    span: Span
    base: str
    low: Expr
    high: Expr


@dataclass(frozen=True, slots=True, eq=False)
class EnumSpec:
    """`(RED, GREEN := 5, BLUE)`."""

    span: Span
    members: tuple[tuple[str, Expr | None, Span], ...]


@dataclass(frozen=True, slots=True, eq=False)
class ArraySpec:
    """`ARRAY [low .. high, ...] OF element`."""

    span: Span
    ranges: tuple[tuple[Expr, Expr], ...]
    element: TypeSpec


@dataclass(frozen=True, slots=True, eq=False)
class StructSpec:
    """`STRUCT fields END_STRUCT`."""

    span: Span
    fields: tuple[Variable, ...]


TypeSpec = NamedType | StringSpec | SubrangeSpec | EnumSpec | ArraySpec | StructSpec


@dataclass(frozen=True, slots=True, eq=False)
class ListValue:
    """`[1, 2, 3(0)]`: initial values of an array as (how often, value)."""

    span: Span
    items: tuple[tuple[Expr | None, InitialValue | None], ...]


@dataclass(frozen=True, slots=True, eq=False)
class FieldValues:
    """`(a := 1, b := 2)`: initial values of a structure or a function block instance."""

    span: Span
    items: tuple[tuple[str, InitialValue, Span], ...]


InitialValue = Expr | ListValue | FieldValues


@dataclass(frozen=True, slots=True, eq=False)
class TypeDeclaration:
    """`name : spec := initial` between TYPE and END_TYPE."""

    span: Span
    name: str
    spec: TypeSpec
    initial: InitialValue | None


@dataclass(frozen=True, slots=True, eq=False)
class Variable:
    """One declared variable.

    Attributes:
        section: `VAR`, `VAR_INPUT`, `VAR_OUTPUT`, `VAR_IN_OUT`, `VAR_TEMP`, `VAR_EXTERNAL`,
            `VAR_GLOBAL`, or `RESULT` for the value of a function.
        type: as written.
        initial: the initial value, if written.
        address: the location after AT, as written, or empty.
        retain: True for RETAIN, False for NON_RETAIN, None where neither is written.
        edge: `R_EDGE` or `F_EDGE` of an input that tells its edges, or empty.
    """

    span: Span
    name: str
    section: str
    type: TypeSpec
    initial: InitialValue | None
    address: str
    address_span: Span
    constant: bool = False
    retain: bool | None = None
    edge: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Pou:
    """A program organisation unit: PROGRAM, FUNCTION_BLOCK or FUNCTION.

    Of a function the variable that holds its value stands first, named after it.
    """

    span: Span
    kind: str
    name: str
    variables: tuple[Variable, ...]
    body: Body


@dataclass(frozen=True, slots=True, eq=False)
class TaskDeclaration:
    """`TASK name (INTERVAL := ..., PRIORITY := ..., SINGLE := ...)` in a resource."""

    span: Span
    name: str
    settings: tuple[tuple[str, Expr, Span], ...]
    resource: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Connection:
    """`name := other` or `name => other` of a program instance."""

    name_span: Span
    name: str
    other: Expr
    is_output: bool


@dataclass(frozen=True, slots=True, eq=False)
class ProgramInstance:
    """`PROGRAM name WITH task : type (connections)` in a resource."""

    span: Span
    name: str
    task: str
    type: str
    type_span: Span
    connections: tuple[Connection, ...] = ()
    resource: str = ""
    retain: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Configuration:
    """A CONFIGURATION with its resources' tasks and program instances.

    Attributes:
        resources: where each RESOURCE stands.
        resource_names: in the same order.
    """

    span: Span
    name: str
    tasks: tuple[TaskDeclaration, ...]
    programs: tuple[ProgramInstance, ...]
    resources: tuple[Span, ...] = ()
    resource_names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Unit:
    """All that one text declares."""

    pous: tuple[Pou, ...]
    types: tuple[TypeDeclaration, ...]
    globals: tuple[Variable, ...]
    configurations: tuple[Configuration, ...]
