// What was recorded of a live world: chains in one water, each of a length that stays for a part of the time.
// A part has a beginning (step), targets that move, and thrusters that may be off.
"use strict";
const Recorded = (() => {
  // The numbers that only a part has, as they were before they were packed.
  function unpack(part) {
    const { bytes } = Salp;
    part.targets = part.targets.map(([step, packed]) => {
      const flat = new Int16Array(bytes(packed));
      const at = (i, axis) => part.middle[axis] + flat[2 * i + axis] * part.grain;
      return [step, Array.from({ length: part.length }, (_, i) => [at(i, 0), at(i, 1)])];
    });
    part.targetAt = (now) => part.targets.findLast(([step]) => step <= now + 1e-6)[1];
    part.reached = new Uint8Array(bytes(part.reached));
  }

  // Parts that there are at a step; at the very end those that last until then.
  function partsAt(parts, step) {
    const endOf = (part) => part.begin + part.steps, last = Math.max(...parts.map(endOf));
    return parts.filter((part) => part.begin <= step + 1e-6
      && (endOf(part) > step + 1e-6 || (endOf(part) === last && step > last - 1e-3)))
      .sort((a, b) => a.chain - b.chain);
  }

  // The view goes with the chains until somebody moves it.
  function follow(camera, state, points, above) {
    const [left, top, width, height] = camera.box, below = 28;
    camera.box = [left, top, width, Math.max(height - above - below, 60)];
    const goal = camera.whole(points, 0.15, 600), now = performance.now();
    const share = state.seen ? 1 - Math.exp((state.seen - now) / 200) : 1; // the same on any machine
    camera.box = [left, top, width, height];
    goal.y += (above - below) / 2 / goal.scale;
    for (const key of ["x", "y", "scale"]) camera[key] = Salp.between(camera[key], goal[key], share);
    state.seen = now;
  }

  function draw(ctx, world, parts, state, end, { unitsAt, drawBodies, colourOf }) {
    const { camera, dt } = parts[0], step = Math.min(state.time, end) / dt, here = partsAt(parts, step);
    const nows = here.map((part) => Math.min(Math.max(step - part.begin + 1e-6, 0), part.steps));
    const units = here.map((part, k) => unitsAt(part, nows[k]));
    const around = { ...world.around.findLast(([from]) => from <= step + 1e-6)?.[1], camera, steps: 1, dt: 1 };
    if (!state.touched) {
      const points = here.flatMap((part, k) => [...units[k].map(({ x, y }) => [x, y]), ...part.targetAt(nows[k])]);
      points.push(...Surroundings.corners({ ...around, target: points, centroid: [] }));
      follow(camera, state, points, 14 + 20 * here.length);
    }
    const [, ...current] = world.current.findLast(([from]) => from <= step + 1e-6);
    Salp.water(ctx, camera, state.time, current);
    Surroundings.streaks(ctx, around, state.time);
    Surroundings.draw(ctx, around);
    here.forEach((part, k) => drawBodies(ctx, part, nows[k], units[k]));
    Salp.scaleBar(ctx, camera);
    here.forEach((part, k) => say(ctx, part, Math.floor(nows[k]), units[k][0], here.length > 1 && colourOf(part), k));
  }

  // How far a chain is from its target; of several, a dot on its first unit says which one.
  function say(ctx, part, now, first, colour, line) {
    const look = Salp.theme(), done = part.reached[now], y = 24 + 20 * line;
    ctx.font = "14px system-ui, sans-serif";
    ctx.fillStyle = done ? look.done : look.faint;
    const apart = `${(100 * part.distance[now]).toFixed(1)} cm to the target${done ? ", reached" : ""}`;
    ctx.fillText(apart, colour ? 34 : 14, y);
    if (!colour) return;
    dot(ctx, [21, y - 5], colour, 5, look);
    dot(ctx, part.camera.toScreen(first.x, first.y), colour, Math.max(4, 0.012 * part.camera.scale), look);
  }

  function dot(ctx, [x, y], colour, radius, look) {
    ctx.beginPath();
    ctx.arc(x, y, radius, 0, 7);
    ctx.fillStyle = colour;
    ctx.fill();
    Salp.stroke(ctx, look.ink, 1.5);
  }

  return { draw, partsAt, unpack };
})();
