// A recording of what swims, in the numbers that the replay page unpacks: `salpchain/web/recorder.py`
// and `report/recorded.py` for the browser. A part is a chain until an edit makes another of it.
"use strict";
const Recorder = (() => {
  const { longest: LONGEST, parts: MOST } = FACTS.recording;
  const STEP = FACTS.physics.control_step;

  const base64 = (array) => {
    const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
    let text = "";
    for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
    return btoa(text);
  };

  class Part {
    constructor(chain, policy, begin, one) {
      Object.assign(this, {
        chain, policy, begin, works: one.works, states: [], thrusts: [], distances: [], reached: [], targets: [], last: null,
      });
      this.add(one);
    }
    goesOn(one, policy) {
      return this.last === one.chain && this.policy === policy && this.works.every((on, i) => on === one.works[i]);
    }
    aim(one) {
      if (this.targets.at(-1)?.[1] !== one.target) this.targets.push([this.thrusts.length, one.target]);
    }
    add(one) {
      const { x, y, a } = one.chain.units;
      this.last = one.chain;
      this.states.push([x.slice(), y.slice(), a.slice()]);
      this.distances.push(one.distance);
      this.reached.push(one.reached);
    }
    /** As `packed_part` has it: positions and angles in 16 bits, thrusts in 8. */
    packed() {
      const n = this.works.length, all = this.states.flatMap(([x, y]) => Array.from(x, (v, i) => [v, y[i]]));
      const every = [...all, ...this.targets.flatMap(([, target]) => target)];
      const range = [0, 1].map((k) => every.reduce(([low, high], p) => [Math.min(low, p[k]), Math.max(high, p[k])], [Infinity, -Infinity]));
      const middle = range.map(([low, high]) => (low + high) / 2), grain = Math.max(...range.map(([low, high]) => high - low), 1e-3) / 65000;
      const points = (some) => base64(Int16Array.from(some.flat(), (value, i) => Math.round((value - middle[i % 2]) / grain)));
      const angle = this.states.flatMap(([, , a]) => Array.from(a, (value) => Math.round(Pond.wrap(value) / Math.PI * 32767)));
      const thrust = this.thrusts.flatMap((row) => Array.from(row, (value) => Math.round(Math.min(Math.max(value, -1), 1) * 127)));
      return {
        chain: this.chain, policy: this.policy, begin: this.begin, length: n, steps: this.thrusts.length, dt: STEP,
        off: this.works.flatMap((on, i) => (on ? [] : [i])), targets: this.targets.map(([step, target]) => [step, points(target)]),
        reached: base64(Uint8Array.from(this.reached)), middle, grain, position: points(all), angle: base64(Int16Array.from(angle)),
        thrust: base64(Int8Array.from(thrust)), distance: base64(Float32Array.from(this.distances)),
      };
    }
  }

  return class {
    static base64(array) { return base64(array); }
    constructor() { Object.assign(this, { steps: 0, open: new Map(), closed: [], numbers: new Map(), current: [], around: [] }); }
    get full() { return this.steps >= LONGEST || this.closed.length + this.open.size >= MOST; }
    get limit() { return `a recording holds at most ${Math.round(LONGEST * STEP / 60)} minutes, ${MOST} edits: this one has ended`; }

    /** Keeps a control step: the chains as they were, edits included, and the world as it is now. */
    keep(before, { chains, current, policy, told: around, world }) {
      const now = new Map(chains.map((one) => [one.name, one])), rounded = current.map((v) => Math.round(v * 1e3) / 1e3);
      if (String(this.current.at(-1)?.slice(1)) !== String(rounded)) this.current.push([this.steps, ...rounded]);
      if (this.around.at(-1)?.[1] !== around) this.around.push([this.steps, around]);
      this.world = world;
      const going = new Map(before.filter((one) => now.has(one.name)).map((one) => [one.name, this.part(one, policy)]));
      for (const [name, part] of this.open) if (going.get(name) !== part) this.closed.push(part);
      for (const [name, part] of going) {
        part.thrusts.push(now.get(name).thrust);
        part.add(now.get(name));
      }
      this.open = going;
      this.steps += 1;
    }

    part(one, policy) {
      let part = this.open.get(one.name);
      if (!part?.goesOn(one, policy)) {
        if (!this.numbers.has(one.name)) this.numbers.set(one.name, this.numbers.size);
        part = new Part(this.numbers.get(one.name), policy, this.steps, one);
      }
      part.aim(one);
      return part;
    }

    /** What the replay page shows, as JSON. */
    page() {
      const parts = [...this.closed, ...this.open.values()].sort((a, b) => a.begin - b.begin || a.chain - b.chain);
      const policies = [...new Set(parts.map(({ policy }) => policy))], where = this.world === "still" ? "" : `, world ${this.world}`;
      const about = `${(this.steps * STEP).toFixed(1)} s, steered by ${policies.join(", ")}${where}`;
      const world = { title: "Recorded on the swim page", about, current: this.current, around: this.around };
      return { swims: parts.map((part) => part.packed()), world, sizes: { unit: [FACTS.physics.unit_length, FACTS.physics.unit_width] } };
    }
  };
})();
