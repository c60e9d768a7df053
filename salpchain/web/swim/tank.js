// The loop that makes the page's world swim: it hears what the page asks for and says how the world
// is, in the messages of `salpchain/web/engine.py`. It runs in a worker, or in the page without one.
"use strict";
const Tank = (() => {
  const { live: BOUNDS, link: LINK, troubles: TROUBLES, grades: GRADES, greedy: GREEDY } = FACTS;
  const { Impossible, apart, lengthOf, placesOf } = Pond;
  const STEP = FACTS.physics.control_step, LATEST = 0.25; // s
  const STILL = { walls: [], posts: [] }, SURVEY = 10; // control steps between two looks at the water
  const short = (value, grain = 1e4) => Math.round(value * grain) / grain;

  /** Steers straight at the target, without a network (`controllers/greedy.py`). */
  const greedy = {
    name: "greedy",
    asked: (view) => view.x.map((x, i) => {
      const [hx, hy] = [-Math.sin(view.a[i]), Math.cos(view.a[i])];
      const error = (view.tx[i] - x) * hx + (view.ty[i] - view.y[i]) * hy, speed = view.vx[i] * hx + view.vy[i] * hy;
      return Math.min(Math.max(GREEDY.pull * error - GREEDY.damping * speed, -1), 1);
    }),
  };

  /** A learned policy as a controller; `one.seen` is what it was shown in the step before. */
  const learned = (policy) => ({
    name: policy.name,
    asked(view, one, silent) {
      const seen = Policy.observe(policy.observation, view, one.seen), wide = seen.length / view.n;
      silent.forEach((is, i) => is && seen.fill(0, i * wide, i * wide + policy.observation.size));
      if (policy.observation.steps > 1) one.seen = seen;
      return Policy.thrusts(policy, Policy.actions(policy, seen, view.n), view.n);
    },
  });

  /** What a controller sees of a chain, as its sensors tell it. */
  function viewOf(one, rows, world) {
    return {
      ...rows, n: lengthOf(one), tx: Float64Array.from(one.target, ([x]) => x), ty: Float64Array.from(one.target, ([, y]) => y),
      thrust: one.thrust, gain: one.works.map((works, i) => (works ? one.gain[i] : 0)), oneSided: world.oneSided, current: world.flow,
    };
  }

  /** The chains, what is around them, and every edit; an edit that cannot be done changes nothing. */
  class World {
    constructor(policy) {
      this.controllers = new Map([[policy.name, learned(policy)], [greedy.name, greedy]]);
      this.flow = (x, y) => { // a person's current, and the world's own
        const [u, v, spin] = this.water?.at(x, y) ?? [0, 0, 0];
        return [this.current[0] + u, this.current[1] + v, spin];
      };
      Object.assign(this, {
        policy: policy.name, current: [0, 0], chains: [], time: 0, epoch: 0, names: 0, kicks: [], seed: 0, world: "still",
        around: STILL, told: STILL, solids: [], water: null, troubles: [], grade: GRADES[1], target: null,
      });
    }

    get size() { return this.chains.reduce((sum, one) => sum + lengthOf(one), 0); }

    /** One straight chain and a target: a random one unless it is given, as a link does. */
    reset(length = this.size || BOUNDS.first, { seed = this.seed + 1, world = this.world, target = null } = {}) {
      this.checkRoom(length);
      const roll = Pond.dice(seed), random = Pond.randomTarget(roll, length, [0, 0]), angle = 2 * Math.PI * roll();
      const one = Pond.straight(this.names + 1, length, [0, 0], angle, random), units = placesOf(one);
      const aim = target?.length === length ? target : Pond.nearerWayRound(random, units);
      Object.assign(this, { seed, world, target: aim, roll, names: this.names + 1, time: 0, epoch: this.epoch + 1, kicks: [] });
      this.around = Sea.obstacles(roll, Sea.WORLDS[world], units, aim);
      this.solids = Sea.solids(this.around);
      this.chains = [Pond.aimed(one, aim)];
      Object.assign(this, { settled: {}, water: null, scale: undefined });
      this.pour(this.troubles, this.grade);
    }

    /** Puts the chains in these troubles, and in no others, as they swim. */
    pour(names, grade) {
      const config = { ...Sea.WORLDS[this.world], ...Sea.settings(names, grade) };
      const { roll } = this, others = (part) => { // what stays as it was is not drawn again
        const before = this.settled[part] ?? "[]";
        this.settled[part] = JSON.stringify(Object.entries(config).filter(([path]) => path.startsWith(part)));
        return this.settled[part] !== before;
      };
      Object.assign(this, { troubles: names, grade, senses: new Sea.Senses(roll, config) });
      if (others("current")) this.water = Sea.flows(config) ? new Sea.Water(roll, config, this.size * LINK) : null;
      if (others("dynamics")) this.scale = Sea.scale(roll, config);
      this.oneSided = Boolean(config["thrusters.one_sided"]);
      this.lag = config["thrusters.lag"]?.[1] ?? 0;
      this.survey();
      if (others("thrusters")) this.chains = this.chains.map((one) => Sea.equipped(roll, one, config, this.time));
    }

    /** Looks at what is around, as pages are told it; of water that moves, once a second. */
    survey() {
      const water = this.water?.seen(this.chains.flatMap((one) => [...placesOf(one), ...one.target])), told = water ? { ...this.around, water } : this.around;
      if (JSON.stringify(told) !== JSON.stringify(this.told)) this.told = told; // else the same to a recording
    }

    retarget(name) {
      this.change(name, (one) => {
        const units = placesOf(one), tries = Array.from({ length: 64 }, () => Pond.randomTarget(this.roll, lengthOf(one), Pond.middle(units)));
        const target = tries.find((some) => Sea.suits(some, units, this.around)) ?? tries.at(-1);
        return Pond.aimed(one, Pond.nearerWayRound(target, units));
      });
    }

    draw(name, points) {
      this.change(name, (one) => {
        const target = Pond.resampled(points, lengthOf(one));
        return Pond.aimed(one, Pond.nearerWayRound(target, placesOf(one)));
      });
    }

    grow(name) {
      const one = this.find(name);
      this.checkRoom(this.size + 1);
      const others = this.chains.filter((other) => other !== one).flatMap(placesOf);
      this.change(name, () => Pond.grown(one, others, Sea.lets(this.around)));
    }

    shrink(name) {
      const one = this.find(name), n = lengthOf(one);
      if (n <= BOUNDS.shortest) throw new Impossible(`a chain has at least ${BOUNDS.shortest} units`);
      this.change(name, () => Pond.part(one, 0, n - 1));
    }

    /** A chain of another length while it swims: units come at its end, or go there. */
    resize(name, length) {
      while (lengthOf(this.find(name)) < length) this.grow(name);
      while (lengthOf(this.find(name)) > length) this.shrink(name);
    }

    switch(name, unit, on) {
      this.change(name, (one) => ({ ...one, works: one.works.map((works, i) => (i === unit ? on : works)) }), unit);
    }

    cut(name, link) {
      if (this.chains.length >= BOUNDS.chains) throw new Impossible(`${BOUNDS.chains} chains swim already: join two of them first`);
      const one = this.find(name), parts = Pond.cut(one, link, this.names + 1);
      this.names += 1;
      this.chains.splice(this.chains.indexOf(one), 1, ...parts);
    }

    /** Cuts the one chain there is into pieces of these lengths, each with its own part of the target. */
    part(pieces, target) {
      let first = 0;
      for (const size of pieces.slice(0, -1)) this.cut(this.chains.at(-1).name, size - 1);
      if (!target || pieces.length < 2) return;
      this.chains = this.chains.map((one) => {
        first += lengthOf(one);
        return Pond.aimed(one, target.slice(first - lengthOf(one), first));
      });
    }

    join(name, other) {
      if (name === other) throw new Impossible("a chain cannot be joined to itself: give two chains");
      const whole = Pond.joined(this.find(name), this.find(other), Sea.lets(this.around));
      this.chains = this.chains.filter((one) => one.name !== other);
      this.change(name, () => whole);
    }

    push(name, unit, x, y) {
      this.find(name, unit);
      const less = Math.min(1, BOUNDS.kick / Math.max(Math.hypot(x, y), 1e-9));
      this.kicks = [...this.kicks, { name, unit, x: x * less, y: y * less }].slice(-BOUNDS.most);
    }

    find(name, unit = 0) {
      const one = this.chains.find((chain) => chain.name === name);
      if (!one) throw new Impossible(`there is no chain ${name} (any more)`);
      if (!(unit >= 0 && unit < lengthOf(one))) throw new Impossible(`chain ${name} has units 0 to ${lengthOf(one) - 1}, got ${unit}`);
      return one;
    }

    change(name, by, unit = 0) {
      const one = this.find(name, unit), changed = by(one);
      this.chains[this.chains.indexOf(one)] = changed;
    }

    checkRoom(units) {
      if (units > BOUNDS.most) throw new Impossible(`the page holds at most ${BOUNDS.most} units, got ${units}`);
    }

    // --- one control step -----------------------------------------------------------------------

    advance() {
      const controller = this.controllers.get(this.policy), all = this.packed();
      const thrust = this.chains.flatMap((one) => Array.from(this.thrustOf(controller, one)));
      this.kick(all);
      const current = this.water || this.current.some(Boolean) ? this.flow : null;
      Physics.step(all, thrust, { solids: this.solids, current, scale: this.scale });
      this.time += 1;
      this.kicks = [];
      this.water?.advance();
      if (this.water && this.time % SURVEY === 0) this.survey();
      if (!all.units.x.every(Number.isFinite)) { this.reset(); return; } // no edit is known to do this
      let first = 0;
      this.chains = this.chains.map((one) => {
        const n = lengthOf(one), chain = sliced(all, first, n);
        const moved = judged({ ...one, chain, thrust: thrust.slice(first, first + n), since: one.since + 1 });
        first += n;
        return { ...moved, works: moved.works.map((works, i) => works && moved.failsAt[i] !== this.time) };
      });
    }

    /** Thrusts (N) that the thrusters of a chain make of those that the controller asks for. */
    thrustOf(controller, one) {
      const { rows, silent } = this.senses.tell(one);
      const asked = this.senses.given(one, controller.asked(viewOf(one, rows, this), one, silent), this.time);
      const keep = this.lag ? Math.exp(-STEP / this.lag) : 0;
      return Array.from(asked, (value, i) => {
        const thrust = (this.oneSided ? Math.max(value, 0) : value) * (one.works[i] ? one.gain[i] : 0);
        return thrust + keep * (one.thrust[i] - thrust);
      });
    }

    /** All chains one after the other; the gap between two of them is no link. */
    packed() {
      const all = Physics.chain(this.size);
      let first = 0;
      for (const { chain } of this.chains) {
        for (const key of Pond.KEYS) { all.units[key].set(chain.units[key], first); all.links[key].set(chain.links[key], first); }
        all.rest.set(chain.rest, 2 * first);
        first += chain.units.x.length;
        if (first < this.size) all.linked[first - 1] = 0;
      }
      return all;
    }

    kick(all) {
      const starts = new Map();
      let first = 0;
      for (const one of this.chains) { starts.set(one.name, [first, lengthOf(one)]); first += lengthOf(one); }
      const sum = this.kicks.reduce((speed, { x, y }) => speed + Math.hypot(x, y), 0);
      const less = this.solids.length ? Math.min(1, BOUNDS.kickAmongWalls / Math.max(sum, 1e-9)) : 1;
      for (const { name, unit, x, y } of this.kicks) {
        const [at, n] = starts.get(name) ?? [0, 0];
        if (unit < n) { all.units.vx[at + unit] += less * x; all.units.vy[at + unit] += less * y; }
      }
    }
  }

  function sliced(all, first, n) {
    const chain = Physics.chain(n);
    for (const key of Pond.KEYS) {
      chain.units[key].set(all.units[key].subarray(first, first + n));
      chain.links[key].set(all.links[key].subarray(first, first + n - 1));
    }
    chain.rest.set(all.rest.subarray(2 * first, 2 * (first + n - 1)));
    return chain;
  }

  /** The chain with how far it is from its target, and whether it has taken it. */
  function judged(one) {
    const places = placesOf(one), distance = places.reduce((sum, p, i) => sum + apart(p, one.target[i]), 0) / places.length;
    const reached = Pond.within(places, one.target, Pond.GOAL);
    return { ...one, distance, reached, arrived: one.arrived ?? (reached ? one.since : null) };
  }

  // --- what the page hears ----------------------------------------------------------------------

  function told(one) {
    const { x, y, a, vx, vy } = one.chain.units, n = x.length, mean = (row) => row.reduce((sum, value) => sum + value, 0) / n;
    const units = Array.from(x, (_, i) => [short(x[i]), short(y[i]), short(a[i], 1e3), short(one.thrust[i], 100), one.works[i] ? 1 : 0]);
    return {
      name: one.name, units, target: one.target.map((point) => point.map((value) => short(value))), turn: short(one.turn),
      distance: short(one.distance), reached: one.reached, arrived: one.arrived === null ? null : short(one.arrived * STEP, 10),
      since: short(one.since * STEP, 10), speed: short(Math.hypot(mean(vx), mean(vy))),
    };
  }

  const HANDLERS = {
    place: ({ world }, m) => world.change(m.chain, (one) => Pond.placed(one, [m.x, m.y], m.turn)),
    draw: ({ world }, m) => world.draw(m.chain, m.points),
    target: ({ world }, m) => world.retarget(m.chain),
    grow: ({ world }, m) => world.grow(m.chain),
    shrink: ({ world }, m) => world.shrink(m.chain),
    resize: ({ world }, m) => world.resize(m.chain, m.length),
    thruster: ({ world }, m) => world.switch(m.chain, m.unit, m.on),
    cut: ({ world }, m) => world.cut(m.chain, m.link),
    join: ({ world }, m) => world.join(m.chain, m.other),
    push: ({ world }, m) => world.push(m.chain, m.unit, m.x, m.y),
    flow: ({ world }, m) => { world.current = [m.x, m.y]; },
    trouble: ({ world }, m) => world.pour(m.names, m.grade),
    reset: ({ world }, m) => world.reset(m.length),
    scene: (loop, m) => loop.begin(m),
    steer: ({ world }, m) => { world.policy = m.policy; world.chains.forEach((one) => { one.seen = null; }); },
    policy: (loop, m) => loop.adopt(m),
    pause: (loop, m) => { loop.paused = m.on; },
    step: (loop) => { loop.paused = true; loop.advance(); },
    pace: (loop, m) => { loop.speed = m.speed; },
    record: (loop, m) => loop.record(m.on),
    watch: (loop, m) => { loop.watched = m.on; },
  };

  /** One world and one loop; `tell` gets every message for the page. */
  class Loop {
    constructor(policy, tell) {
      Object.assign(this, { tell, paused: false, speed: 1, watched: true, took: 0, recorder: null, recorded: 0 });
      this.world = new World(policy);
    }

    /** Begins a scene: length, pieces, seed, world, target, troubles, policy; what is left out is as usual. */
    begin({ length = BOUNDS.first, pieces = [], seed = 1, world = "still", target = null, troubles = [], grade = GRADES[1], current = [0, 0], policy }) {
      Object.assign(this.world, { troubles: [], current });
      if (policy !== undefined) this.take(policy);
      this.world.reset(length, { seed, world, target });
      this.world.part(pieces, target);
      if (troubles.length) this.world.pour(troubles, grade);
      this.paused = false;
    }

    /** Lets a policy that a link names swim, if the page has it. */
    take(name) {
      if (this.world.controllers.has(name)) HANDLERS.steer(this, { policy: name });
      else this.tell({ type: "error", text: `this page does not have the policy ${name}: drop its file here` });
    }

    welcome() {
      this.tell({
        type: "welcome", policies: [...this.world.controllers.keys()], step: STEP, most: BOUNDS.most, world: this.world.world,
        troubles: Object.keys(TROUBLES), grades: GRADES, unit: [FACTS.physics.unit_length, FACTS.physics.unit_width], link: LINK,
      });
    }

    /** Lets a policy from a file swim from now on. */
    adopt({ buffer }) {
      const policy = Policy.fromFile(buffer);
      while (this.world.controllers.has(policy.name)) policy.name += " (yours)";
      this.world.controllers.set(policy.name, learned(policy));
      HANDLERS.steer(this, { policy: policy.name });
      this.welcome();
      this.tell({ type: "notice", text: `${policy.name} swims now` });
    }

    hear(message) {
      try {
        HANDLERS[message.type](this, message);
      } catch (error) {
        if (!(error instanceof Impossible || error instanceof Policy.Refusal)) throw error;
        this.tell({ type: "error", text: error.message });
      }
      this.show();
    }

    advance() {
      const begin = performance.now(), before = this.world.chains;
      this.world.advance();
      this.took = performance.now() - begin;
      if (this.recorder) {
        this.recorder.keep(before, this.world);
        if (this.recorder.full) { this.tell({ type: "error", text: this.recorder.limit }); this.record(false); }
      }
      this.show();
    }

    record(on) {
      if (on) { this.recorder = new Recorder(); return; }
      const { recorder } = this;
      this.recorder = null;
      if (!recorder?.steps) throw new Impossible("nothing was recorded: the chains did not swim meanwhile");
      this.recorded += 1;
      this.tell({ type: "recording", number: this.recorded, data: recorder.page() });
    }

    show() {
      const { world } = this;
      this.tell({
        type: "state", time: short(world.time * STEP, 10), epoch: world.epoch, paused: this.paused, speed: this.speed,
        policy: world.policy, loading: "", took: short(this.took, 100), current: world.current.map((v) => short(v)),
        troubles: world.troubles, grade: world.grade, roughening: false, around: world.told,
        recording: this.recorder ? short(this.recorder.steps * STEP, 10) : null, recorded: this.recorded,
        scene: { world: world.world, seed: world.seed }, chains: world.chains.map(told),
      });
    }

    /** Swims for ever, at the pace that is asked for; late steps are not caught up with. */
    run() {
      let due = performance.now();
      const turn = () => {
        if (this.paused || !this.watched) due = performance.now() + 1000 * STEP / 4;
        else {
          this.advance();
          due += 1000 * STEP / this.speed;
          if (performance.now() - due > 1000 * LATEST) due = performance.now();
        }
        setTimeout(turn, Math.max(due - performance.now(), 0));
      };
      turn();
    }
  }

  /** How a policy does from recorded starts: (success, control steps) of each; see the tests. */
  function play(policy, { units, target }, limit) {
    const controller = learned(policy), world = { oneSided: false, flow: () => [0, 0, 0] };
    let one = Pond.laid(1, units.map(([x, y]) => [x, y]), units.map(([, , a]) => a), target);
    for (let time = 1; time <= limit; time++) {
      const thrust = controller.asked(viewOf(one, one.chain.units, world), one, []);
      Physics.step(one.chain, thrust);
      one = judged({ ...one, thrust });
      if (one.reached) return { success: true, steps: time };
    }
    return { success: false, steps: limit };
  }

  /** A loop that hears and tells by messages; the first it hears are the weights of its policy. */
  function serve(tell) {
    let loop = null;
    return (message) => {
      if (message.type !== "begin") { loop.hear(message); return; }
      loop = new Loop(Policy.fromSafetensors(message.weights), tell);
      loop.begin(message.scene);
      loop.welcome();
      loop.run();
    };
  }

  return { Loop, World, learned, play, serve, viewOf };
})();

if (typeof document === "undefined" && typeof importScripts === "function") { // in a worker
  const hear = Tank.serve((message) => postMessage(message));
  onmessage = (event) => hear(event.data);
  postMessage({ type: "ready" });
}
