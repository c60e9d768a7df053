// What units observe, and the network that steers them: `salpchain/tasks/features.py` and the graph
// convolution of `salpchain/networks` for the browser. Files are read as data; nothing of them runs.
"use strict";
const Policy = (() => {
  const { observations: LAYOUTS, sensed: SENSED, neighbour: NEIGHBOUR } = FACTS;
  const LARGEST = 64 * 1024 * 1024; // bytes of a file (chosen)
  const DEEPEST = 8; // graph layers

  /** What is wrong with a file, as a sentence for its reader. */
  class Refusal extends Error {}

  // --- observations -----------------------------------------------------------------------------
  // A view has rows (Float64Array, a number of each unit) in world axes and SI units. A feature is a
  // function of it that gives its rows.

  /**
   * @typedef {{n: number, x: Float64Array, y: Float64Array, a: Float64Array, vx: Float64Array,
   *   vy: Float64Array, w: Float64Array, tx: Float64Array, ty: Float64Array, thrust: ArrayLike<number>,
   *   gain: ArrayLike<number>, oneSided: boolean, current: Flow}} View
   */
  const rows = (n, value) => Float64Array.from({ length: n }, (_, i) => value(i));
  const mean = (row) => row.reduce((sum, value) => sum + value, 0) / row.length;
  const compress = (row) => row.map((x) => Math.sign(x) * Math.log1p(5 * Math.abs(x)));
  const times = (pair, factor) => pair.map((row) => row.map((x) => x * factor));
  const less = ([x, y], [u, v]) => [x.map((value, i) => value - u[i]), y.map((value, i) => value - v[i])];
  const wrap = (angle) => angle - 2 * Math.PI * Math.floor((angle + Math.PI) / (2 * Math.PI));

  /** World vectors in each unit's axes: along the unit, along its heading. */
  const own = ({ a }, [x, y]) => [
    x.map((value, i) => Math.cos(a[i]) * value + Math.sin(a[i]) * y[i]),
    y.map((value, i) => Math.cos(a[i]) * value - Math.sin(a[i]) * x[i]),
  ];
  const toNext = ([x, y], side) => [x, y].map((row) => row.map((value, i) => {
    const j = i + side;
    return j < 0 || j >= row.length ? 0 : row[j] - value;
  }));
  const shared = (view, pair) => pair.map((row) => rows(view.n, () => mean(row))); // the mean, for each
  const velocity = ({ vx, vy }) => [vx, vy];
  const position = ({ x, y }) => [x, y];
  const target = ({ tx, ty }) => [tx, ty];
  const water = (view) => [0, 1].map((axis) => rows(view.n, (i) => view.current(view.x[i], view.y[i])[axis]));
  const error = (view) => less(target(view), position(view));
  const force = ({ thrust, a, n }) => [rows(n, (i) => -thrust[i] * Math.sin(a[i])), rows(n, (i) => thrust[i] * Math.cos(a[i]))];
  const centres = (view) => less(shared(view, target(view)), shared(view, position(view)));

  function aim(view) {
    const [x, y] = error(view);
    const size = x.map((value, i) => 1 / (Math.hypot(value, y[i]) + 0.01));
    return [x.map((value, i) => value * size[i]), y.map((value, i) => value * size[i])];
  }

  function aside(view) {
    const away = less(position(view), shared(view, position(view)));
    const size = Math.sqrt(mean(away[0].map((x, i) => x * x + away[1][i] ** 2)));
    return times(away, 1 / (size + 0.01));
  }

  /** To the nearest unit that is no neighbour: 1 - distance / SENSED long. */
  function nearest({ n, x, y }) {
    const [u, v] = [new Float64Array(n), new Float64Array(n)];
    for (let i = 0; i < n; i++) {
      let [least, count, sx, sy] = [Infinity, 0, 0, 0];
      for (let j = 0; j < n; j++) {
        if (Math.abs(i - j) < 2) continue;
        const dx = x[j] - x[i], dy = y[j] - y[i], square = dx * dx + dy * dy;
        if (square < least) [least, count, sx, sy] = [square, 0, 0, 0];
        if (square === least) { count += 1; sx += dx; sy += dy; }
      }
      const apart = Math.max(Math.sqrt(least), 1e-6);
      const share = Math.max(1 / apart - 1 / SENSED, 0) / Math.max(count, 1);
      u[i] = sx * share; v[i] = sy * share;
    }
    return [u, v];
  }

  const bearing = (side) => (view) => {
    const [x, y] = toNext(position(view), side);
    return [rows(view.n, (i) => (x[i] || y[i] ? wrap(Math.atan2(y[i], x[i]) - view.a[i]) : 0))];
  };
  const neighbourForce = (side) => (view) => force(view).map((row) => row.map((_, i) => row[i + side] ?? 0));
  const bit = (place) => (view) => [rows(view.n, (i) => (i >> place) & 1)];
  const inUnit = (pair) => (view) => own(view, pair(view));
  const far = (pair) => (view) => own(view, pair(view)).map(compress);
  const side = (points, way) => (view) => own(view, times(toNext(points(view), way), 1 / NEIGHBOUR));

  // By the name of a feature's first field and its unit, as `features.py` has them.
  const ROWS = {
    "velocity along, 0.2 m/s": (v) => own(v, times(velocity(v), 5)),
    "previous unit minus own position along": side(position, -1),
    "next unit minus own position along": side(position, 1),
    "previous target point minus own target point along": side(target, -1),
    "next target point minus own target point along": side(target, 1),
    "direction to own target point along": inUnit(aim),
    "mean velocity of the chain along": (v) => own(v, times(shared(v, velocity(v)), 5)),
    "own position minus centroid along": inUnit(aside),
    "own target point minus own position along, m": inUnit(error),
    "own target point minus own position along": far(error),
    "centroid of the target minus centroid along, m": inUnit(centres),
    "centroid of the target minus centroid along": far(centres),
    "angular velocity, 3 rad/s": (v) => [v.w.map((x) => x / 3)],
    "place in the chain": (v) => [rows(v.n, (i) => i * 2 / Math.max(v.n - 1, 1) - 1)],
    "direction to the nearest unit that is no neighbour along": (v) => own(v, times(nearest(v), 2)),
    ...Object.fromEntries([0, 1, 2, 3].map((place) => [`bit ${place} of the unit's index`, bit(place)])),
    "position x": position, "velocity x": velocity,
    "angle": (v) => [v.a.map(wrap)], "angular velocity, rad/s": (v) => [v.w],
    "velocity minus mean velocity x": (v) => less(velocity(v), shared(v, velocity(v))),
    "position minus centroid x": (v) => less(position(v), shared(v, position(v))),
    "position minus centroid of the target x": (v) => less(position(v), shared(v, target(v))),
    "own target point minus position x": error,
    "bearing of the previous unit": bearing(-1), "bearing of the next unit": bearing(1),
    "last force of the previous unit x": neighbourForce(-1), "last force of the next unit x": neighbourForce(1),
    "velocity against the water along": (v) => own(v, times(less(velocity(v), water(v)), 5)),
    "gain of the own thruster": (v) => [rows(v.n, (i) => v.gain[i])],
    "gain of the own thruster backwards": (v) => [rows(v.n, (i) => (v.oneSided ? 0 : v.gain[i]))],
    "own thrust in the last step, as it acted": (v) => [rows(v.n, (i) => v.thrust[i])],
  };
  const rowsOf = ([name, unit]) => ROWS[`${name}, ${unit}`] ?? ROWS[name];

  /** How an observation is worked out: its features, its numbers, and how many steps it shows. */
  function observer(observation) {
    const [name, star, count] = String(observation).split(/(\*)/), steps = star ? Number(count) : 1;
    const layout = Object.hasOwn(LAYOUTS, name) ? LAYOUTS[name] : null;
    const features = layout?.map(rowsOf);
    if (!features || features.includes(undefined) || !(steps >= 1 && steps <= 64)) {
      throw new Refusal(`This page cannot show a chain what the policy observes (${short(observation)}).`);
    }
    return { features, steps, size: layout.reduce((sum, [, , numbers]) => sum + numbers, 0), jets: jetsIn(layout) };
  }

  /** Where the gains of the own thruster, forwards and backwards, are in it; null if it has none. */
  function jetsIn(layout) {
    const starts = {};
    layout.reduce((at, [name, , numbers]) => { starts[name] = at; return at + numbers; }, 0);
    const places = [starts["gain of the own thruster"], starts["gain of the own thruster backwards"]];
    return places.includes(undefined) ? null : places;
  }

  /** @returns {Float64Array} (unit, feature), of `before` the steps that it still shows */
  function observe({ features, steps, size }, view, before = null) {
    const now = features.flatMap((feature) => feature(view)), wide = size * steps;
    const seen = new Float64Array(view.n * wide);
    for (let i = 0; i < view.n; i++) {
      for (let k = 0; k < size; k++) seen[i * wide + k] = now[k][i];
      for (let k = size; k < wide; k++) seen[i * wide + k] = before ? before[i * wide + k - size] : now[k % size][i];
    }
    return seen;
  }

  // --- network ----------------------------------------------------------------------------------

  const GRAIN = 1024, EDGE = 6; // gelu is read off a table: linear between its points, to 1e-7
  let table = null; // made when the first policy swims

  const geluTable = () => Float64Array.from({ length: 2 * EDGE * GRAIN + 2 }, (_, i) => {
    const x = i / GRAIN - EDGE;
    return 0.5 * x * (1 + erf(x * Math.SQRT1_2));
  });

  /** The error function by its series, to 1e-8. */
  function erf(x) {
    let [term, sum] = [x, x];
    for (let k = 1; Math.abs(term) > 1e-12; k++) { term *= -x * x / k; sum += term / (2 * k + 1); }
    return 2 / Math.sqrt(Math.PI) * sum;
  }

  function gelu(row) {
    const GELU = table ??= geluTable();
    for (let i = 0; i < row.length; i++) {
      const x = row[i];
      if (x <= -EDGE) row[i] = 0;
      else if (x < EDGE) {
        const at = (x + EDGE) * GRAIN, first = Math.floor(at), part = at - first;
        row[i] = GELU[first] + part * (GELU[first + 1] - GELU[first]);
      }
    }
  }

  /** x W + b. The weights lie as (output, input); four rows and two outputs at once. */
  function linear(x, n, { weight, bias, inputs, outputs }) {
    const out = new Float64Array(n * outputs);
    for (let r = 0; r < n; r += 4) {
      const r1 = Math.min(r + 1, n - 1) * inputs, r2 = Math.min(r + 2, n - 1) * inputs, r3 = Math.min(r + 3, n - 1) * inputs, r0 = r * inputs;
      for (let j = 0; j < outputs; j += 2) {
        const w0 = j * inputs, w1 = Math.min(j + 1, outputs - 1) * inputs;
        let [a0, a1, a2, a3, b0, b1, b2, b3] = [0, 0, 0, 0, 0, 0, 0, 0];
        for (let k = 0; k < inputs; k++) {
          const u = weight[w0 + k], v = weight[w1 + k];
          const x0 = x[r0 + k], x1 = x[r1 + k], x2 = x[r2 + k], x3 = x[r3 + k];
          a0 += u * x0; a1 += u * x1; a2 += u * x2; a3 += u * x3;
          b0 += v * x0; b1 += v * x1; b2 += v * x2; b3 += v * x3;
        }
        put(out, n, outputs, r, j, bias[j], a0, a1, a2, a3);
        if (j + 1 < outputs) put(out, n, outputs, r, j + 1, bias[j + 1], b0, b1, b2, b3);
      }
    }
    return out;
  }

  function put(out, n, outputs, r, j, bias, v0, v1, v2, v3) {
    out[r * outputs + j] = v0 + bias;
    if (r + 1 < n) out[(r + 1) * outputs + j] = v1 + bias;
    if (r + 2 < n) out[(r + 2) * outputs + j] = v2 + bias;
    if (r + 3 < n) out[(r + 3) * outputs + j] = v3 + bias;
  }

  /** Own features and those of the units that a link joins, normalised by both degrees. */
  function gather(x, n, wide, improved) {
    const out = new Float64Array(n * wide), again = improved ? 2 : 1;
    const scale = (i) => 1 / Math.sqrt(again + (i > 0) + (i < n - 1));
    for (let i = 0; i < n; i++) {
      const here = scale(i), before = i ? scale(i - 1) : 0, after = i < n - 1 ? scale(i + 1) : 0;
      for (let k = 0; k < wide; k++) {
        let sum = again * here * x[i * wide + k];
        if (before) sum += before * x[(i - 1) * wide + k];
        if (after) sum += after * x[(i + 1) * wide + k];
        out[i * wide + k] = here * sum;
      }
    }
    return out;
  }

  function normalise(x, n, wide) {
    for (let i = 0; i < n; i++) {
      let [sum, square] = [0, 0];
      for (let k = i * wide; k < (i + 1) * wide; k++) sum += x[k];
      sum /= wide;
      for (let k = i * wide; k < (i + 1) * wide; k++) { x[k] -= sum; square += x[k] * x[k]; }
      const scale = 1 / Math.sqrt(square / wide + 1e-5);
      for (let k = i * wide; k < (i + 1) * wide; k++) x[k] *= scale;
    }
  }

  /** @returns {Float64Array} mean actions (unit, act) of what the units of one chain observe */
  function actions(policy, seen, n) {
    const action = forward(policy, seen, n);
    if (!policy.oneWay) return action;
    const wide = policy.trunk[0].inputs, acts = action.length / n, [ahead, back] = policy.observation.jets;
    const units = Array.from(rows(n, (i) => seen[i * wide + ahead] > 0 && seen[i * wide + back] <= 0));
    if (!units.includes(1)) return action;
    const other = forward(policy.oneWay, seen, n);
    return action.map((value, k) => (units[Math.floor(k / acts)] ? other[k] : value));
  }

  function forward(policy, seen, n) {
    let x = seen;
    policy.trunk.forEach((layer, k) => {
      if (k) normalise(x, n, layer.inputs);
      x = linear(gather(x, n, layer.inputs, policy.improved), n, layer);
      gelu(x);
    });
    policy.actor.forEach((layer, k) => {
      if (k) gelu(x);
      x = linear(x, n, layer);
    });
    return x;
  }

  /** Thrusts (N) of actions: one number clipped, or two of which the second is taken away. */
  function thrusts(policy, action, n) {
    const clip = (value) => Math.min(Math.max(value, -1), 1);
    if (policy.action === "thrust") return rows(n, (i) => clip(action[i]));
    return rows(n, (i) => (clip(action[2 * i]) - clip(action[2 * i + 1])) / 2);
  }

  // --- files ------------------------------------------------------------------------------------

  const short = (text) => String(text).replace(/[^\x20-\x7e]/g, "?").slice(0, 60);

  function half(bits) {
    const sign = bits & 0x8000 ? -1 : 1, power = (bits >> 10) & 31, part = bits & 1023;
    if (power === 31) return part ? NaN : sign * Infinity;
    return sign * (power ? 2 ** (power - 15) * (1 + part / 1024) : 2 ** -14 * part / 1024);
  }

  const READ = {
    F16: [2, (view, at) => half(view.getUint16(at, true))],
    F32: [4, (view, at) => view.getFloat32(at, true)],
    F64: [8, (view, at) => view.getFloat64(at, true)],
  };

  /** Tensors of a safetensors file by name: {shape, values}; and its metadata. */
  function tensors(buffer) {
    const damaged = new Refusal("This is no whole safetensors file: it is damaged or cut short.");
    if (buffer.byteLength < 10 || buffer.byteLength > LARGEST) throw damaged;
    const view = new DataView(buffer), size = Number(view.getBigUint64(0, true));
    if (!(size > 1 && size <= buffer.byteLength - 8)) throw damaged;
    let header;
    try { header = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(new Uint8Array(buffer, 8, size))); } catch { throw damaged; }
    const found = new Map();
    for (const [name, about] of Object.entries(header ?? {})) {
      if (name === "__metadata__") continue;
      found.set(name, tensor(view, 8 + size, about, damaged));
    }
    return { found, metadata: header?.__metadata__ };
  }

  function tensor(view, begin, about, damaged) {
    const { dtype, shape, data_offsets: offsets } = about ?? {}, kind = Object.hasOwn(READ, dtype) ? READ[dtype] : null;
    if (!kind || !Array.isArray(shape) || !Array.isArray(offsets)) throw damaged;
    const count = shape.reduce((product, side) => product * side, 1), [from, end] = offsets, [bytes, read] = kind;
    const good = [from, end, count, ...shape].every((value) => Number.isSafeInteger(value) && value >= 0);
    if (!good || end - from !== count * bytes || begin + end > view.byteLength) throw damaged;
    const values = new Float64Array(count);
    for (let i = 0; i < count; i++) values[i] = read(view, begin + from + i * bytes);
    if (!values.every(Number.isFinite)) throw new Refusal("The policy holds numbers that are none.");
    return { shape, values };
  }

  /** A layer as `linear` takes it, of weights (input, output) and a bias. */
  function layer(weight, bias, name) {
    const [inputs, outputs] = weight?.shape ?? [];
    if (weight?.shape.length !== 2 || bias?.shape.length !== 1 || bias.shape[0] !== outputs || !inputs || !outputs) {
      throw new Refusal(`The policy has no layer ${short(name)} of the right shape.`);
    }
    const turned = new Float64Array(inputs * outputs);
    for (let k = 0; k < inputs; k++) for (let j = 0; j < outputs; j++) turned[j * inputs + k] = weight.values[k * outputs + j];
    return { weight: turned, bias: bias.values, inputs, outputs };
  }

  /** Raises a Refusal unless the page can run such a network. */
  function checkServed({ model, graph, critic = "" }) {
    if (model !== "gcn" || graph !== "mixed") {
      throw new Refusal(`This page runs graph convolutions (gcn) on the graph mixed; this policy is ${short(model)} on ${short(graph)}. salpchain live runs it.`);
    }
    return critic;
  }

  /** A policy whose layers fit each other, what it observes and how it acts. */
  function assembled(about, trunk, actor) {
    const { name, observation, action } = about, sees = observer(observation);
    const acts = { thrust: 1, pair: 2 }[action], layers = [...trunk, ...actor];
    const fits = layers.every(({ inputs }, k) => inputs === (k ? layers[k - 1].outputs : sees.size * sees.steps));
    if (!acts || !fits || layers[layers.length - 1].outputs !== acts) {
      throw new Refusal("The layers of this policy do not fit what its header says of it.");
    }
    return { name: short(name), observation: sees, action, improved: about.improved === true, trunk, actor };
  }

  /** The policy of a `policy.safetensors` of salpchain (or of the weights in this page). */
  function fromSafetensors(buffer) {
    const { found, metadata } = tensors(buffer);
    let about;
    try { about = JSON.parse(metadata.salpchain); } catch { about = null; }
    if (about?.kind !== "policy" || !about.header?.control || about.version !== 1) {
      throw new Refusal("This is no policy of salpchain: drop the policy.safetensors of a training.");
    }
    const { control, world } = about.header, kind = /dynamics\.kind (\w+)/.exec(world ?? "")?.[1];
    checkServed(control);
    if (control.memory) throw new Refusal("The units of this policy remember, which this page does not run: salpchain live runs it.");
    if (kind) throw new Refusal(`This policy was trained with the dynamics ${short(kind)}, which this page does not have: evaluate it with salpchain.`);
    if (control.by_jet !== true) return network(found, about.header, "");
    const policy = network(found, about.header, "both_ways.");
    if (!policy.observation.jets) throw new Refusal("The units of this policy act by their jets, but do not observe them.");
    return { ...policy, oneWay: network(found, about.header, "one_way.") };
  }

  /** The network whose tensors have this prefix. */
  function network(found, header, prefix) {
    const at = (name) => layer(found.get(`${prefix}${name}.weight`), found.get(`${prefix}${name}.bias`), name);
    const deeper = Math.min(Math.max(Math.trunc(header.control.depth ?? 2) - 2, 0), DEEPEST);
    const more = Array.from({ length: deeper }, (_, k) => at(`trunk.more[${k}].linear`));
    const trunk = [at("trunk.first.linear"), at("trunk.second.linear"), ...more];
    const actor = [0, 1, 2].map((k) => at(`actor.layers[${k}]`));
    return assembled({ ...header, improved: header.control.improved }, trunk, actor);
  }

  /** The policy of any file: told apart by its first bytes. */
  function fromFile(buffer) {
    const first = new Uint8Array(buffer, 0, Math.min(9, buffer.byteLength));
    return first[8] === 0x7b ? fromSafetensors(buffer) : Onnx.policy(buffer, { Refusal, assembled, checkServed, layer });
  }

  return { Refusal, actions, fromFile, fromSafetensors, observe, observer, thrusts };
})();
