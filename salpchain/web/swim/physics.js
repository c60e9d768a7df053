// The engine of `salpchain/physics` for the browser: one control step of chains of units and links.
// What it computes is the Python engine's, held to it by tests/web/test_swim_engine.py. Numbers that
// have one home in Python (constants, margins) come in `FACTS`, which the builder writes.
"use strict";
const Physics = (() => {
  const { physics: P, slack: SLACK, closed: CLOSED, harder: HARDER, deepest: DEEPEST } = FACTS;
  const DT = P.control_step / P.substeps;
  const UNIT = [P.unit_length / 2, P.unit_width / 2]; // half sizes
  const TOUCHING = Math.hypot(P.unit_length, P.unit_width); // of centres; beyond, no units touch
  const UNIT_INERTIA = P.unit_mass * (P.unit_length ** 2 + P.unit_width ** 2) / 12;
  const LINK_INERTIA = P.link_mass * P.link_length ** 2 / 12;

  /**
   * Bodies in the plane, each number an array: position (m), angle (rad), their rates.
   * @typedef {{x: Float64Array, y: Float64Array, a: Float64Array,
   *            vx: Float64Array, vy: Float64Array, w: Float64Array}} Bodies
   * @typedef {{units: Bodies, links: Bodies, rest: Float64Array, linked: Uint8Array,
   *            touching: boolean, blocked: boolean}} Chain
   * `rest` holds two angles for each link (rad): link minus first unit, link minus second unit.
   * @typedef {{cx: number, cy: number, cos: number, sin: number, hx: number, hy: number,
   *            rim: number}} Solid  a box with a rounded rim; a post is rim alone
   * @typedef {(x: number, y: number) => [number, number, number]} Flow  of the water at a point (m):
   *            velocity (m/s), and spin (rad/s)
   * @typedef {{mass: number, drag: number, stiffness: number}} Scale  times the usual
   */
  const AS_IT_IS = { mass: 1, drag: 1, stiffness: 1 };

  /** @returns {Bodies} so many bodies at the origin, at rest */
  function bodies(count) {
    const made = {};
    for (const name of ["x", "y", "a", "vx", "vy", "w"]) made[name] = new Float64Array(count);
    return made;
  }

  /** @returns {Chain} so many units at the origin, every link acting */
  function chain(count) {
    const gaps = Math.max(count - 1, 0);
    return {
      units: bodies(count), links: bodies(gaps), rest: new Float64Array(2 * gaps),
      linked: new Uint8Array(gaps).fill(1), touching: false, blocked: false,
    };
  }

  /** log(1 + exp(x)) of x >= 0, by the engine's own polynomial: chattering joints amplify any other. */
  function softplus(x) {
    const centred = 2 * Math.exp(-x) - 1;
    let value = FACTS.log1p[FACTS.log1p.length - 1];
    for (let k = FACTS.log1p.length - 2; k >= 0; k--) value = value * centred + FACTS.log1p[k];
    return x + value;
  }

  /** Size (N) of the force between two surfaces this far (m) apart. */
  const repulsion = (gap) => P.contact_stiffness * P.softness
    * softplus(Math.max(P.contact_gap - gap, 0) / P.softness);

  /** Force on a unit for each metre that its joint is open; none while it is closed. */
  function pull(dx, dy, stiffness) {
    const distance = Math.sqrt(dx * dx + dy * dy);
    if (distance < CLOSED) return 0;
    return stiffness * P.joint_stiffness * P.softness * softplus(distance / P.softness) / distance;
  }

  const twist = (bend) => P.angle_stiffness * (Math.exp(Math.abs(bend)) - 1) * Math.sign(bend);

  // --- two boxes; the first is at the origin, `pair` says how they lie -------------------------

  const SIGNS = [[1, 1], [1, -1], [-1, -1], [-1, 1]]; // of the four corners
  const pair = { hx: 0, hy: 0, ox: 0, oy: 0, c: 1, s: 0, fhx: 0, fhy: 0, fc: 1, fs: 0 };
  const near = { x: 0, y: 0, bx: 0, by: 0 }; // the point on the first, and the way from the other's
  const deep = { depth: 0, x: 0, y: 0, nx: 0, ny: 0 };
  const clamp = (value, most) => Math.min(Math.max(value, -most), most);

  function lay(first, half, second, otherHalf) {
    pair.hx = half[0]; pair.hy = half[1]; pair.fhx = otherHalf[0]; pair.fhy = otherHalf[1];
    pair.ox = second.x - first.x; pair.oy = second.y - first.y;
    pair.c = first.c; pair.s = first.s; pair.fc = second.c; pair.fs = second.s;
  }

  /** Fills `near` with the closest of the eight corners and their nearest points. */
  function closestPoints() {
    const { hx, hy, ox, oy, c, s, fhx, fhy, fc, fs } = pair;
    let least = Infinity;
    for (let k = 0; k < 8; k++) {
      const [along, across] = SIGNS[k % 4];
      let x, y, tx, ty;
      if (k < 4) {
        x = hx * along * c - hy * across * s; y = hx * along * s + hy * across * c;
        const px = x - ox, py = y - oy;
        const u = clamp(px * fc + py * fs, fhx), v = clamp(py * fc - px * fs, fhy);
        tx = ox + u * fc - v * fs; ty = oy + u * fs + v * fc;
      } else {
        tx = ox + fhx * along * fc - fhy * across * fs; ty = oy + fhx * along * fs + fhy * across * fc;
        const u = clamp(tx * c + ty * s, hx), v = clamp(ty * c - tx * s, hy);
        x = u * c - v * s; y = u * s + v * c;
      }
      const bx = x - tx, by = y - ty, square = bx * bx + by * by;
      if (square < least) { least = square; near.x = x; near.y = y; near.bx = bx; near.by = by; }
    }
  }

  /** For both boxes: offset in its axes, and how far apart along each the centres must be. */
  function axes() {
    const { hx, hy, ox, oy, c, s, fhx, fhy, fc, fs } = pair;
    const cosine = Math.abs(c * fc + s * fs), sine = Math.abs(c * fs - s * fc);
    return [
      [c, s, ox * c + oy * s, oy * c - ox * s, hx + fhx * cosine + fhy * sine, hy + fhx * sine + fhy * cosine],
      [fc, fs, ox * fc + oy * fs, oy * fc - ox * fs, fhx + hx * cosine + hy * sine, fhy + hx * sine + hy * cosine],
    ];
  }

  const overlap = () => axes().every(([, , u, v, ru, rv]) => Math.abs(u) < ru && Math.abs(v) < rv);

  /** Fills `deep`: depth of two boxes that overlap, a point on the first, and its way out. */
  function deepestPoints() {
    deep.depth = Infinity;
    axes().forEach(([c, s, u, v, ru, rv], which) => {
      [[c, s, u, ru], [-s, c, v, rv]].forEach(([ax, ay, place, reach]) => {
        const way = reach - Math.abs(place), flip = place > 0 ? -1 : 1;
        if (!(way < deep.depth)) return;
        deep.depth = way; deep.nx = ax * flip; deep.ny = ay * flip;
        [deep.x, deep.y] = cornerTowards(which === 0, deep.nx, deep.ny);
      });
    });
  }

  function cornerTowards(mine, nx, ny) {
    const { hx, hy, ox, oy, c, s, fhx, fhy, fc, fs } = pair, sign = (value) => (value < 0 ? -1 : 1);
    if (!mine) {
      const u = -hx * sign(nx * c + ny * s), v = -hy * sign(ny * c - nx * s);
      return [u * c - v * s, u * s + v * c];
    }
    const fu = fhx * sign(nx * fc + ny * fs), fv = fhy * sign(ny * fc - nx * fs);
    const px = ox + fu * fc - fv * fs, py = oy + fu * fs + fv * fc;
    const u = clamp(px * c + py * s, hx), v = clamp(py * c - px * s, hy);
    return [u * c - v * s, u * s + v * c];
  }

  // --- what may touch in a control step ---------------------------------------------------------

  /** Pairs (i, j, i, j, ...) of units: neighbours always, others where they may come near. */
  function candidates(units) {
    const n = units.x.length, found = [], reach = TOUCHING + SLACK;
    const way = new Float64Array(n);
    for (let i = 0; i < n; i++) way[i] = reach / 2 + Math.hypot(units.vx[i], units.vy[i]) * P.control_step;
    for (let i = 0; i < n; i++) {
      if (i + 1 < n) found.push(i, i + 1);
      for (let j = i + 2; j < n; j++) {
        const dx = units.x[j] - units.x[i], most = way[i] + way[j];
        if (dx > most || dx < -most) continue;
        const dy = units.y[j] - units.y[i];
        if (dx * dx + dy * dy < most * most) found.push(i, j);
      }
    }
    return found;
  }

  /** Units and solids (unit, solid, ...) that may touch, at any speed that is in the water. */
  function solidsNear(units, solids) {
    const n = units.x.length, found = [];
    let speed = 0;
    for (let i = 0; i < n; i++) speed = Math.max(speed, Math.hypot(units.vx[i], units.vy[i]));
    const reach = TOUCHING / 2 + P.contact_gap + SLACK + speed * P.control_step;
    solids.forEach((one, k) => {
      for (let i = 0; i < n; i++) {
        const dx = units.x[i] - one.cx, dy = units.y[i] - one.cy;
        const u = Math.max(Math.abs(dx * one.cos + dy * one.sin) - one.hx, 0);
        const v = Math.max(Math.abs(dy * one.cos - dx * one.sin) - one.hy, 0);
        if (u * u + v * v < (reach + one.rim) ** 2) found.push(i, k);
      }
    });
    return found;
  }

  /** Adds to the loads (N, N m) what units push each other with; true if any did. */
  function contact(units, pairs, fx, fy, torque) {
    let touched = false;
    const first = { x: 0, y: 0, c: 1, s: 0 }, second = { x: 0, y: 0, c: 1, s: 0 };
    for (let k = 0; k < pairs.length; k += 2) {
      const i = pairs[k], j = pairs[k + 1];
      const dx = units.x[j] - units.x[i], dy = units.y[j] - units.y[i];
      if (dx * dx + dy * dy > TOUCHING * TOUCHING) continue;
      turn(first, units, i); turn(second, units, j);
      lay(first, UNIT, second, UNIT);
      closestPoints();
      const gap = Math.sqrt(near.bx ** 2 + near.by ** 2), scale = 1 / Math.max(gap, 1e-9);
      if (gap > P.contact_gap || overlap()) continue;
      const size = repulsion(gap), px = size * near.bx * scale, py = size * near.by * scale;
      const tx = near.x - near.bx - dx, ty = near.y - near.by - dy;
      fx[i] += px; fy[i] += py; torque[i] += near.x * py - near.y * px;
      fx[j] -= px; fy[j] -= py; torque[j] -= tx * py - ty * px;
      touched = touched || px !== 0 || py !== 0;
    }
    return touched;
  }

  function turn(body, units, i) {
    body.x = units.x[i]; body.y = units.y[i];
    body.c = Math.cos(units.a[i]); body.s = Math.sin(units.a[i]);
  }

  /** The same of solids: inside one the force goes on along the shortest way out. */
  function obstruction(units, solids, pairs, fx, fy, torque) {
    let blocked = false;
    const unit = { x: 0, y: 0, c: 1, s: 0 };
    for (let k = 0; k < pairs.length; k += 2) {
      const i = pairs[k], one = solids[pairs[k + 1]];
      const around = TOUCHING / 2 + Math.hypot(one.hx, one.hy) + one.rim;
      if (Math.hypot(one.cx - units.x[i], one.cy - units.y[i]) > around) continue;
      turn(unit, units, i);
      lay(unit, UNIT, { x: one.cx, y: one.cy, c: one.cos, s: one.sin }, [one.hx, one.hy]);
      closestPoints();
      let { x, y, bx: nx, by: ny } = near, gap = Math.sqrt(nx * nx + ny * ny);
      nx /= Math.max(gap, 1e-9); ny /= Math.max(gap, 1e-9);
      if (overlap()) {
        deepestPoints();
        ({ x, y, nx, ny } = deep);
        gap = -(one.rim > 0 ? deep.depth : HARDER * Math.min(deep.depth, DEEPEST));
      }
      gap -= one.rim;
      if (gap > P.contact_gap) continue;
      const size = repulsion(gap), px = size * nx, py = size * ny;
      fx[i] += px; fy[i] += py; torque[i] += x * py - y * px;
      blocked = true;
    }
    return blocked;
  }

  // --- substeps ---------------------------------------------------------------------------------

  /** Velocity first, then position (semi-implicit Euler); `keep` is what drag leaves. */
  function integrate(b, fx, fy, torque, mass, inertia, keep) {
    const push = DT / mass, spin = DT / inertia;
    for (let i = 0; i < b.x.length; i++) {
      b.vx[i] = b.vx[i] * keep + fx[i] * push; b.vy[i] = b.vy[i] * keep + fy[i] * push;
      b.w[i] = b.w[i] * keep + torque[i] * spin;
      b.x[i] += b.vx[i] * DT; b.y[i] += b.vy[i] * DT; b.a[i] += b.w[i] * DT;
    }
  }

  /** Adds the forces of joints and angles to the loads of units and links. */
  function joints({ units: u, links: l, rest, linked }, half, stiffness, on, by) {
    for (let k = 0; k < l.x.length; k++) {
      by.fx[k] = by.fy[k] = by.torque[k] = 0;
      if (!linked[k]) continue;
      const hx = half.x[k], hy = half.y[k];
      const ax = l.x[k] - hx - u.x[k], ay = l.y[k] - hy - u.y[k], first = pull(ax, ay, stiffness);
      const bx = l.x[k] + hx - u.x[k + 1], by_ = l.y[k] + hy - u.y[k + 1], second = pull(bx, by_, stiffness);
      const t1 = stiffness * twist(l.a[k] - (u.a[k] + rest[2 * k])), t2 = stiffness * twist(l.a[k] - (u.a[k + 1] + rest[2 * k + 1]));
      const f1x = first * ax, f1y = first * ay, f2x = second * bx, f2y = second * by_;
      on.fx[k] += f1x; on.fy[k] += f1y; on.torque[k] += t1;
      on.fx[k + 1] += f2x; on.fy[k + 1] += f2y; on.torque[k + 1] += t2;
      by.fx[k] = -(f1x + f2x); by.fy[k] = -(f1y + f2y);
      by.torque[k] = hx * (f1y - f2y) - hy * (f1x - f2x) - t1 - t2;
    }
  }

  /** Half links turned by a small angle, by its Taylor series as in `substeps.py`. */
  function turnHalves(half, spin) {
    for (let k = 0; k < half.x.length; k++) {
      const angle = DT * spin[k], square = angle * angle;
      const sine = angle * (1 - square * (1 / 6 - square / 120)), versine = square * (1 / 2 - square / 24);
      const x = half.x[k], y = half.y[k];
      half.x[k] = x - y * sine - x * versine; half.y[k] = y + x * sine - y * versine;
    }
  }

  const loads = (count) => ({ fx: new Float64Array(count), fy: new Float64Array(count), torque: new Float64Array(count) });

  /**
   * Moves chains one control step (0.1 s) on, in place, under thrusts (N) held for the whole step.
   * @param {Chain} chain
   * @param {ArrayLike<number>} thrust of each unit, along its heading
   * @param {{contact?: boolean, solids?: Solid[], current?: Flow, scale?: Scale}} around
   */
  function step(chain, thrust, { contact: touch = true, solids = [], current = null, scale = AS_IT_IS } = {}) {
    const { units, links } = chain, n = units.x.length, gaps = links.x.length, drag = P.drag * scale.drag;
    if (current) { carry(units, current, drag); carry(links, current, drag); }
    const push = loads(n), on = loads(n), by = loads(gaps);
    const half = { x: new Float64Array(gaps), y: new Float64Array(gaps) };
    for (let i = 0; i < n; i++) {
      push.fx[i] = -thrust[i] * Math.sin(units.a[i]); push.fy[i] = thrust[i] * Math.cos(units.a[i]);
    }
    for (let k = 0; k < gaps; k++) {
      half.x[k] = P.link_length / 2 * Math.cos(links.a[k]); half.y[k] = P.link_length / 2 * Math.sin(links.a[k]);
    }
    const pairs = touch ? candidates(units) : [], against = solids.length ? solidsNear(units, solids) : [];
    chain.touching = chain.blocked = false;
    for (let index = 0; index < P.substeps; index++) {
      on.fx.set(push.fx); on.fy.set(push.fy); on.torque.fill(0);
      if (contact(units, pairs, on.fx, on.fy, on.torque)) chain.touching = true;
      if (obstruction(units, solids, against, on.fx, on.fy, on.torque)) chain.blocked = true;
      joints(chain, half, scale.stiffness, on, by);
      const keep = index ? 1 : 1 - drag;
      integrate(links, by.fx, by.fy, by.torque, P.link_mass * scale.mass, LINK_INERTIA * scale.mass, keep);
      integrate(units, on.fx, on.fy, on.torque, P.unit_mass * scale.mass, UNIT_INERTIA * scale.mass, keep);
      turnHalves(half, links.w);
    }
  }

  /** Velocities from which a step's drag becomes that against water that flows. */
  function carry(b, current, drag) {
    const share = drag / (1 - drag);
    for (let i = 0; i < b.x.length; i++) {
      const [x, y, spin] = current(b.x[i], b.y[i]);
      b.vx[i] += share * x; b.vy[i] += share * y; b.w[i] += share * spin;
    }
  }

  /** @returns {Solid} a wall between two ends (m), or a post */
  const wall = ([ax, ay, bx, by, width]) => {
    const length = Math.hypot(bx - ax, by - ay);
    return { cx: (ax + bx) / 2, cy: (ay + by) / 2, cos: (bx - ax) / length, sin: (by - ay) / length, hx: length / 2, hy: width / 2, rim: 0 };
  };
  const post = ([x, y, radius]) => ({ cx: x, cy: y, cos: 1, sin: 0, hx: 0, hy: 0, rim: radius });

  return { DT, LINK: P.link_length, bodies, chain, post, step, wall };
})();
