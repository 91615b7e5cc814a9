"""Draws the guide's equations as SVG, in the page's text colour: `.venv/bin/python web_assets/make/equations.py`."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path as Outline
from matplotlib.textpath import TextPath

FOLDER = Path(__file__).resolve().parent.parent / "guide" / "equations"
SIZE = 100
"""Font size in units of the drawing: fine enough for whole-numbered coordinates."""
PIXELS = 17
"""Font size on the page, px."""
INDENT, GAP, PAD = 160, 60, 12
"""Indent of a continuation line, gap between lines, and margin, in units of the drawing."""

EQUATIONS: dict[str, list[str]] = {
    "point": [r"R(s,t)=\genfrac{(}{)}{0}{0}{x_0}{y_0}+s\,e_1+w(s,t)\,e_2", r"w(s,t)=N(s)\,q(t)"],
    "energy": [
        r"E_k=\frac{1}{2}\int\rho\,|\dot{R}|^2\,ds",
        r"E_p=\frac{1}{2}\int EI\left(\dfrac{\partial^2w}{\partial s^2}\right)^2ds",
    ],
    "beam": [r"A_{21}\ddot{x}+A_{22}\ddot{q}+B_{21}\dot{x}+B_{22}\dot{q}", r"> +\,D\,\dot{q}+K_F\,q=0"],
    "modes": [r"f_k=\dfrac{\pi k^2}{2L^2}\sqrt{\dfrac{EI}{\rho}}"],
    "quasi-static": [
        r"q_{\mathrm{qs}}=-K_F^{-1}\,(h\,a_\perp+g\,\ddot{\theta}\,)",
        r"a_\perp=\cos\theta\;\ddot{y}_0-\sin\theta\;\ddot{x}_0",
    ],
    "joints": [
        r"\dot{\theta}_i=J_i(\theta)^{-1}J_i(x)\,\dot{x}=\mathcal{J}_i\,\dot{x}",
        r"u_i=\mathcal{J}_i^{\,T}\,\tau_i",
    ],
    "arm": [r"\bar{M}_i\,\ddot{x}+\bar{C}_i\,\dot{x}+\bar{G}_i=u_i-J_i(x)^T f_i"],
    "system": [r"M\,\ddot{p}+C\,\dot{p}+G=\genfrac{(}{)}{0}{0}{u_1+u_2}{0}", r"p=[\,x_0,\;y_0,\;\theta,\;q\,]"],
    "internal": [r"f=J_1(x)^Tf_1+J_2(x)^Tf_2", r"F_i=J_i(x)^Tf_i-\frac{1}{2}f\,,\quad F_1+F_2=0"],
    "sliding": [r"e=x-x_d\,,\quad r=\dot{x}_d-\Lambda e", r"s=\dot{x}-r=\dot{e}+\Lambda e"],
    "law": [
        r"u_i=(\bar{M}_i+\frac{1}{2}\bar{A})\,\dot{r}+\bar{C}_i\,r+\bar{G}_i",
        r"> -\,\frac{1}{2}K s-\frac{1}{2}\,\hat{\Psi}\,\dfrac{s}{\max(\|s\|,\,\varepsilon)}",
    ],
    "bound": [r"\hat{\Psi}=\hat{b}_0+\hat{b}_1\|x\|+\hat{b}_2\|\dot{x}\|^2"],
    "adaptation": [
        r"\dot{\hat{b}}_0=\dfrac{\|s\|}{k_0}\,,\quad \dot{\hat{b}}_1=\dfrac{\|s\|\,\|x\|}{k_1}",
        r"\dot{\hat{b}}_2=\dfrac{\|s\|\,\|\dot{x}\|^2}{k_2}",
    ],
    "lyapunov": [
        r"\mathcal{V}=\frac{1}{2}s^T\bar{M}s+\frac{1}{2}\,\sum_j\,k_j\,(b_j-\hat{b}_j)^2",
        r"\dot{\mathcal{V}}\leq -s^TKs\quad\mathrm{for}\;\|s\|>\varepsilon",
    ],
    "squeeze": [
        r"F_1=-\frac{1}{2}(\bar{M}_1-\bar{M}_2)\,\dot{s}",
        r"> -\,\frac{1}{2}(\bar{C}_1-\bar{C}_2)\,s",
    ],
    "damping": [
        r"u_i\;\leftarrow\;u_i+\frac{1}{2}(\bar{M}_1+\bar{M}_2)\genfrac{(}{)}{0}{0}{a\,e_2}{\alpha}",
        r"a=k_v\,h^T\dot{q}\,,\quad \alpha=k_\theta\,g^T\dot{q}",
    ],
}
"""Name → lines; a line that starts with "> " continues the one before."""


def outline(line: str) -> tuple[TextPath, float]:
    """A line's outline and where it starts, in units of the drawing."""
    continued = line.startswith("> ")
    path = TextPath((0, 0), f"${line.removeprefix('> ')}$", size=SIZE, prop=FontProperties(math_fontfamily="stix"))
    return path, INDENT if continued else 0


def path_data(path: TextPath, dx: float, dy: float) -> str:
    """The outline as SVG path data in whole numbers, moved by (dx, dy), with y downwards."""
    letters = {Outline.MOVETO: "M", Outline.LINETO: "L", Outline.CURVE3: "Q", Outline.CURVE4: "C"}
    words = []
    for points, code in path.iter_segments(curves=True, simplify=False):
        if code == Outline.CLOSEPOLY:
            words.append("Z")
            continue
        pairs = points.reshape(-1, 2)
        words.append(letters[code] + " ".join(f"{round(x + dx)} {round(dy - y)}" for x, y in pairs))
    return "".join(words)


def picture(lines: list[str]) -> str:
    """Lines below one another, as SVG."""
    data, width, height = [], 0.0, float(PAD)
    for line in lines:
        path, indent = outline(line)
        box = path.get_extents()
        height += box.y1
        data.append(path_data(path, PAD + indent - box.x0, height))
        height += -box.y0 + GAP
        width = max(width, indent + box.width + 2 * PAD)
    height += PAD - GAP
    scale = PIXELS / SIZE
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width * scale:.0f}" height="{height * scale:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" fill="currentColor"><path d="{"".join(data)}"/></svg>\n'
    )


if __name__ == "__main__":
    mpl.rcParams["mathtext.fontset"] = "stix"
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, lines in EQUATIONS.items():
        (FOLDER / f"{name}.svg").write_text(picture(lines), encoding="utf-8")
