"""What is asked of a record rather than of its analysis: files to write, and which pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from workbench.core.machine.files import replacing
from workbench.core.records.forms import File
from workbench.core.records.option import Options, option
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.build.compile_fmu import CompiledFmu
    from workbench.build.container import ContainerResult
    from workbench.build.export import ExportResult
    from workbench.build.fmu import BuiltModels
    from workbench.build.result import SystemFile
    from workbench.data.excite.request import Excite
    from workbench.identification.identify.request import Identify
    from workbench.identification.identify.result import IdentifyResult
    from workbench.identification.structures.result import StructureResult
    from workbench.limit_cycles.feed_forward.request import FeedForward
    from workbench.limit_cycles.feed_forward.result import FeedForwardResult
    from workbench.limit_cycles.feedback.request import Feedback

__all__ = ["EXTRAS", "Written"]


class Written(Options):
    """The files that a record is written to, besides its JSON.

    Attributes:
        drawn: options that pages and pictures are told.
        plotted: options that the picture alone is told.
    """

    drawn: ClassVar[tuple[str, ...]] = ()
    plotted: ClassVar[tuple[str, ...]] = ()

    _: KW_ONLY
    csv: File | None = option("Write the result as CSV.", default=None)
    plot: File | None = option("Write the picture: .png, .svg or .pdf.", default=None)
    report: File | None = option("Write one self-contained page, .html: pictures, tables, data.", default=None)

    def told(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Return options by name.

        Args:
            names: `drawn`, `plotted` or both.
        """
        return {name: getattr(self, name) for name in names}

    def check(self, asked: Any) -> None:  # noqa: ANN401 - of the command's class
        """Refuse what cannot be drawn or written, before the analysis is run.

        Args:
            asked: the request.

        Raises:
            InputError: what is missing.
        """

    def write(self, record: Any) -> Iterator[str | Path]:  # noqa: ANN401 - of the command's class
        """Write further files; yield each that is written.

        Args:
            record: what was found.

        Raises:
            InputError: a file cannot be written.
        """
        yield from ()


class _Nfr(Written):
    drawn = ("offset",)

    _: KW_ONLY
    offset: bool = option("Also draw the mean of the output.", default=False)


class _Excite(Written):
    def check(self, asked: Excite) -> None:
        """Refuse to choose the signal: nobody knows which amplitude a model tolerates."""
        if asked.prbs is asked.multisine is None:
            raise InputError("a signal is needed: --prbs amplitude=1,rate=.. or --multisine band=LOW:HIGH,amplitude=1")


class _Feedback(Written):
    plotted = ("plot_kind",)

    _: KW_ONLY
    plot_kind: str = option(
        "Picture that --plot writes.",
        choices=("overview", "root-locus", "nyquist", "cycles", "settling", "run"),
        default="overview",
    )

    def check(self, asked: Feedback) -> None:
        if self.plot is None and self.plot_kind != "overview":
            raise InputError("--plot-kind needs --plot")
        there = {"settling": ("--settle", asked.settle), "run": ("--gain", asked.gain is not None)}
        needed, given = there.get(self.plot_kind, ("", True))
        if not given:
            raise InputError(f"--plot-kind: {self.plot_kind} needs {needed}")


class _FeedForward(Written):
    plotted = ("figure",)

    _: KW_ONLY
    figure: str = option(
        "Which picture --plot writes.",
        choices=("overview", "reduced", "compensation", "mirrored", "simulated", "error", "poles"),
        default="overview",
    )
    out: File | None = option("Write the filter: .json (matrices) or .fmu.", default=None)

    def check(self, asked: FeedForward) -> None:
        if asked.inputs is None and (asked.crude or self.figure == "simulated"):
            raise InputError("--crude and --figure simulated need a simulation: give --input, which starts the motion")
        if self.out is not None:
            from workbench.build.export import check_linear_file  # noqa: PLC0415 - seldom needed

            check_linear_file(Path(self.out))

    def write(self, record: FeedForwardResult) -> Iterator[str | Path]:
        from workbench.build.export import write_linear  # noqa: PLC0415 - seldom needed

        if self.out is not None:
            write_linear(record.filter_dict(), Path(self.out))
            yield self.out


class _Identify(Written):
    _: KW_ONLY
    bode: File | None = option("Write a Bode plot of the model beside what --lin, --nfr or both hold.", default=None)

    def check(self, asked: Identify) -> None:
        if self.bode is not None and asked.lin is asked.nfr is None:
            raise InputError("--bode: give what to compare the model with: --lin, --nfr or both")

    def write(self, record: IdentifyResult | StructureResult) -> Iterator[str | Path]:
        overlay = getattr(record, "overlay", None)
        if self.bode is not None and overlay is not None:
            overlay.plot(self.bode)
            yield self.bode


class _Envelope(Written):
    _: KW_ONLY
    worst: File | None = option(
        "Write the model of the worst case as a system file, .toml; of several models, each with its name added.",
        default=None,
    )

    def check(self, asked: Any) -> None:  # noqa: ANN401 - see `Written`
        if self.worst is not None and Path(self.worst).suffix.lower() != ".toml":
            raise InputError(f"--worst: {self.worst} is not a system file; name it .toml")

    def write(self, record: Any) -> Iterator[str | Path]:  # noqa: ANN401 - of a layer above
        if self.worst is None:
            return
        systems = {} if record.worst is None else record.worst.systems
        if not systems:
            raise InputError(
                "--worst: the worst case cannot be written as a system file, because its margin is unknown or its "
                "model is neither an FMU nor a system in TOML; run the command lines shown to measure it again"
            )
        path = Path(self.worst)
        for name, text in systems.items():
            file = path if len(systems) == 1 else path.with_stem(f"{path.stem}_{name}")
            with replacing(file) as part:
                part.write_text(text, encoding="utf-8")
            yield file


class _Build(Written):
    def write(self, record: BuiltModels) -> Iterator[str | Path]:
        """Yield the FMUs, which are there already."""
        yield from record.files


class _Export(Written):
    def write(self, record: CompiledFmu | ExportResult | ContainerResult | SystemFile) -> Iterator[str | Path]:
        """Yield the file, which is there already."""
        yield record.file


# Name of the command → what is asked of its record; of all others `Written` alone.
EXTRAS: dict[str, type[Written]] = {
    "nfr": _Nfr,
    "excite": _Excite,
    "feedback": _Feedback,
    "feed-forward": _FeedForward,
    "identify": _Identify,
    "envelope": _Envelope,
    "build": _Build,
    "compile": _Export,
    "export": _Export,
}
