"""What the guide names is on the screen under that name."""

import re

from flexlab.guide import chapters
from flexlab.lab.plots import tabs
from flexlab.lab.session import Session
from flexlab.presets import load_preset


def text_of(identity: str) -> str:
    return next(chapter.text for chapter in chapters() if chapter.id == identity)


def test_every_tab_and_every_plot_is_explained() -> None:
    text = text_of("reading-the-plots")
    for tab, plots in tabs(load_preset("paper")).items():
        assert f"#### {tab}" in text
        for plot in plots:
            assert re.split(r",|:", plot.title)[0] in text
            for label in plot.labels:
                unit = re.findall(r"\((.+)\)", label)[0]
                assert unit in text, f"{plot.title}: {unit}"


def test_every_word_in_italics_in_the_guide_is_a_label_on_the_page(session: Session) -> None:
    gui = session.server.gui
    handles = [*gui._gui_input_handle_from_uuid.values()]
    names = {getattr(handle._impl.props, "label", "") for handle in handles}
    for container in gui._container_handle_from_uuid.values():
        for child in container._children.values():
            names |= set(getattr(child._impl.props, "_tab_labels", ()))
    for identity in ("reading-the-plots", "keys-and-tips"):
        for word in re.findall(r"(?<!\*)\*([^*\n]+)\*(?!\*)", text_of(identity)):
            assert any(re.fullmatch(re.escape(word) + r"( \(.*\))?", name) for name in names), word
