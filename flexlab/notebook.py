"""A live lab in a notebook's cell."""

from html import escape
from typing import TYPE_CHECKING

from flexlab.arguments import whole_number
from flexlab.presets import AnyLaw, AnyPath, AnyScenario, named_scenario
from flexlab.text import CELL_HEIGHT

if TYPE_CHECKING:
    from flexlab.lab.session import Session


class Lab:
    """A live lab of a scenario: `with flexlab.Lab("soft-beam") as lab: display(lab)`, until the block ends or `close()`.

    Takes the scenario, law and path that `simulate` takes. The lab serves this machine only, on any free port; `url` opens it in
    a browser, and `session.runner` takes commands. Raises `LabError` if it cannot be started.
    """

    def __init__(
        self, scenario: AnyScenario = "paper", height: int = CELL_HEIGHT, law: AnyLaw = None, path: AnyPath = None
    ):
        self._height = whole_number("height", height, 1)
        self._name, self._scenario = named_scenario(scenario, law, path)
        self._session: Session | None = None

    def open(self) -> "Lab":
        """Start the lab if it is not running."""
        if self._session is None:
            from flexlab.lab.session import Session

            session = Session(self._scenario, self._name)
            session.start()
            self._session = session
        return self

    def close(self) -> None:
        """Stop the lab. May be called twice."""
        session, self._session = self._session, None
        if session is not None:
            session.stop()

    @property
    def session(self) -> "Session":
        """The lab's session, started if need be; its `runner` takes commands and has the newest `snapshot`."""
        self.open()
        assert self._session is not None
        return self._session

    @property
    def url(self) -> str:
        """The lab's address on this machine; starts the lab if need be."""
        return self.session.url

    def __enter__(self) -> "Lab":
        return self.open()

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        where = f"open at {self._session.url}" if self._session is not None else "not open"
        return f"<Lab of {self._name}: {where}>"

    def _repr_html_(self) -> str:
        return f'<iframe src="{escape(self.url)}" width="100%" height="{self._height}" style="border:0"></iframe>'
