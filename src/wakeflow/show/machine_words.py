"""Measures of a machine in the words of its sketch and its plan, and where its curtain falls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.quantities import metres, say

if TYPE_CHECKING:
    from ..scene import Body, Feed, Scene, Vibration


def feed_words(scene: Scene) -> str:
    """The curtain in two lines: its width and fall, its mass flow."""
    feed = scene.feed
    lines = [f"feed: {metres(feed.width)} wide, {fall_words(feed)}"]
    if feed.position:
        lines[0] += f", x = {metres(feed.position)}"
    if feed.rate is not None:
        lines.append(f"{say(feed.rate, 'kg/s')} over a depth of {metres(feed.depth)}")
    if scene.funnel is not None:
        lines.append(f"from a funnel with an outlet of {metres(scene.funnel.orifice)}")
    return "\n".join(lines)


def feed_corners(scene: Scene) -> NDArray[np.float64]:
    """Corners (4, 2) m of the falling curtain: its left and right end where it begins, then right and left at the
    body, or where it enters a channel without one.
    """
    (height, _), half = scene.release, scene.feed.width / 2
    x = scene.feed.position + half * np.array([-1.0, 1.0, 1.0, -1.0])
    y = np.array([scene.level + height, scene.level + height, scene.level, scene.level])
    return scene.plumb.placed(np.stack([x, y], axis=1))


def tilt_words(scene: Scene) -> str:
    """Where gravity points in a channel that does not stand upright; empty where it does."""
    tilt = scene.channel.tilt
    side = "right" if tilt > 0.0 else "left"
    return "" if scene.plumb.upright else f"gravity {say(abs(tilt), 'rad', 3)} from its axis, to the {side}"


def fall_words(feed: Feed) -> str:
    """How the curtain comes down."""
    if feed.start == "resting":
        return "at rest on the body"
    return f"comes at {say(feed.speed, 'm/s')}" if feed.speed is not None else f"falls {metres(feed.height or 0.0)}"


def motion_words(vibration: Vibration) -> str:
    """Frequency, reach to either side, and peak acceleration of the bodies."""
    reach = metres(float(np.hypot(*vibration.displacement)), 3)
    if vibration.pivot is not None:
        x, y = (metres(part) for part in vibration.pivot)
        reach = f"{say(vibration.given['angle'], 'rad', 3)} about x = {x}, y = {y}"
    return f"{say(1.0 / vibration.period, 'Hz', 4)}, ± {reach} ({vibration.strength:.3g} g)"


def body_words(name: str, body: Body, whole: Scene | None) -> str:
    """A body's measures, its place unless that is the origin, and of the first one the motion of all."""
    size, given = np.ptp(body.outline(), axis=0), body.given
    if "thickness" in given:
        measures = f"{metres(given['length'])} x {metres(given['thickness'])}"
    elif body.shape == "circle":
        measures = f"{metres(float(size[0]))} across"
    else:
        measures = f"{metres(float(size[0]), 4)} x {metres(float(size[1]), 4)}"
    angle = f", {say(given['slope_angle'], 'rad', 4)}" if "slope_angle" in given else ""
    lines = [f"{name}: {measures}{angle}"]
    if any(body.at):
        lines.append(f"at x = {metres(body.at[0])}, y = {metres(body.at[1])}")
    if whole is not None and whole.vibration is not None:
        lines.append(f"{'vibrates' if len(whole.body) == 1 else 'all vibrate'} at {motion_words(whole.vibration)}")
    return "\n".join(lines)
