"""The command that shows in half a minute what twolink does."""

import typer

from twolink.cli.common import Html, NoBrowser, require_writable, show_motion

ACCURACIES = (1e-3, 1e-6, 1e-9, 1e-12)


def demo(html: Html = None, no_browser: NoBrowser = False) -> None:
    """Show in half a minute what twolink does.

    It ends with the paper's arm moving in the browser.

    \b
    twolink demo
    twolink demo --html demo.html        a page to keep instead of a browser
    """
    from twolink.lagrange.check import check
    from twolink.scenes import load_scene
    from twolink.simulation.scene_run import simulate

    require_writable([] if html is None else [html], (".html",))
    typer.echo("1/3  the paper's two-link arm: hand-derived equations against Pinocchio, 1,000 random arms")
    rows = {row.quantity: row for row in check(n=1000).rows}
    wrong = [name for name, row in rows.items() if row.misprinted]
    typer.echo(f"     accelerations agree to {rows['acceleration, ABA'].corrected:.0e} of their size; "
               f"the paper's print errs in {' and '.join(wrong)}")  # fmt: skip
    scene = load_scene("arm-swing")
    typer.echo(f"2/3  what accuracy costs: the arm swings for {scene.duration:g} s")
    for accuracy in ACCURACIES:
        run = simulate(scene, accuracy=accuracy)
        if run.error is not None and run.cost is not None:
            seconds, compiling = run.cost.seconds + run.cost.verify_seconds, run.cost.compile_seconds
            typer.echo(f"     asked for {accuracy:.0e} rad: error at most {run.error[-1]:.0e} rad, solved in "
                       f"{1e3 * seconds:.1f} ms, and {compiling:.2g} s of preparing")  # fmt: skip
    typer.echo("3/3  the motion in the browser" if html is None else "3/3  the motion as a page")
    show_motion(run, html, no_browser)
