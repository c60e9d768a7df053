// Curves over time in panels of their own below one another, with one axis of time.
"use strict";
const Curves = (() => {
  const LEFT = 56, RIGHT = 22, TITLE = 25, BELOW = 20; // pixels
  const FONT = "12px system-ui, sans-serif";

  // The smallest of 1, 2 or 5 times a power of ten that is not less.
  function roundUp(value) {
    const power = 10 ** Math.floor(Math.log10(value));
    return power * [1, 2, 5, 10].find((k) => k * power >= value * (1 - 1e-9));
  }

  // Round values from 0 to the most, so many pixels apart or more.
  function ticksTo(most, pixels, least) {
    const step = roundUp((most * least) / Math.max(pixels, least));
    const count = Math.floor(most / step + 1e-9);
    return Array.from({ length: count + 1 }, (_, i) => +(i * step).toPrecision(12));
  }

  const named = (value, unit) => (value === 0 ? "0" : `${+value.toPrecision(6)} ${unit}`.trim());

  // panels: {title, unit, most, lines: [{values, dt, begin, colour, goesOn}]}; where everything is, in pixels.
  function layout(width, height, panels, end) {
    const high = (height - BELOW) / panels.length - TITLE, across = width - LEFT - RIGHT;
    const times = ticksTo(end, across, 70);
    return {
      left: LEFT, width: across, end, times,
      panels: panels.map((panel, k) => {
        const rough = ticksTo(panel.most, high, 22), step = rough[1] ?? panel.most;
        const top = Math.ceil(panel.most / step - 1e-9) * step;
        return { ...panel, top, ticks: ticksTo(top, high, 22), y: k * (high + TITLE) + TITLE, height: high };
      }),
    };
  }

  // Draws all panels and a cursor at a time; returns what was written, as [text, x, y, width, height].
  function draw(ctx, placed, time, look) {
    const texts = [];
    const say = (text, x, y, align, colour) => {
      ctx.font = FONT;
      ctx.textAlign = "left";
      ctx.fillStyle = colour;
      const wide = ctx.measureText(text).width, at = x - wide * { left: 0, center: 0.5, right: 1 }[align];
      ctx.fillText(text, at, y);
      texts.push([text, at, y - 9, wide, 11]);
    };
    for (const panel of placed.panels) drawPanel(ctx, placed, panel, look, say);
    const { y, height } = placed.panels.at(-1);
    for (const tick of placed.times) say(named(tick, "s"), across(placed, tick), y + height + 15, "center", look.faint);
    drawCursor(ctx, placed, time, look);
    return texts;
  }

  const across = (placed, time) => placed.left + (time / placed.end) * placed.width;
  const up = (panel, value) => panel.y + panel.height * (1 - value / panel.top);

  function line(ctx, points, colour, width) {
    ctx.beginPath();
    points.forEach(([x, y], i) => (i ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
    Salp.stroke(ctx, colour, width);
  }

  function drawPanel(ctx, placed, panel, look, say) {
    const right = placed.left + placed.width, low = panel.y + panel.height;
    for (const tick of panel.ticks) {
      const y = up(panel, tick);
      line(ctx, [[placed.left, y], [right, y]], tick ? look.line : look.axis, tick ? 1 : 1.5); // 0: the zero line
      line(ctx, [[placed.left - 4, y], [placed.left, y]], look.axis, 1);
      say(named(tick, panel.unit), placed.left - 8, y + 4, "right", look.faint);
    }
    for (const tick of placed.times) {
      const x = across(placed, tick);
      line(ctx, [[x, low], [x, low + 4]], look.axis, 1);
    }
    line(ctx, [[placed.left, panel.y], [placed.left, low]], look.axis, 1);
    say(panel.title, placed.left, panel.y - 8, "left", look.ink);
    for (const { values, dt, begin, colour, goesOn } of panel.lines) {
      const points = Array.from(values, (value, t) => [across(placed, begin + t * dt), up(panel, value)]);
      line(ctx, points, colour, 1.8);
      if (points.length && !goesOn) dot(ctx, points.at(-1), colour, 2.6);
    }
  }

  function dot(ctx, [x, y], colour, radius) {
    ctx.beginPath();
    ctx.arc(x, y, radius, 0, 7);
    ctx.fillStyle = colour;
    ctx.fill();
  }

  // A line at a time through all panels, and where it meets the curves.
  function drawCursor(ctx, placed, time, look) {
    const x = across(placed, time);
    for (const panel of placed.panels) {
      line(ctx, [[x, panel.y], [x, panel.y + panel.height]], look.ink, 1.2);
      for (const { values, dt, begin, colour } of panel.lines) {
        const since = time - begin, at = Math.min(Math.floor(since / dt + 1e-9), values.length - 1);
        if (at < 0 || since > values.length * dt + 1e-9) continue;
        dot(ctx, [x, up(panel, values[at])], look.page, 5.5);
        dot(ctx, [x, up(panel, values[at])], colour, 4);
      }
    }
  }

  const timeAt = (placed, x) => ((x - placed.left) / placed.width) * placed.end;

  return { draw, layout, ticksTo, timeAt };
})();
