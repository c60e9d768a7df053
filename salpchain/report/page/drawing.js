// What both pages draw: water, targets, chains, jets, trails. All lengths in metres, y upwards.
"use strict";
const Salp = (() => {
  // unit: along the chain and across it, link: what a page is told; scale: how many times longer than
  // the paper's links are those of the chain that is drawn, whose units are then rigid links
  const sizes = {};
  const own = (camera) => camera.scale * (sizes.scale ?? 1);
  const CORNER = 0.4, REACHED = 0.0513, JET = 0.075;
  const FAINTEST = 0.005, SHORTEST_JET = 0.25; // N; of a whole jet (as in report/shapes.py)
  const PLACES = ["#22c3d6", "#3fd79a", "#b9e04f", "#ffc54a", "#ff8a5c", "#f7609f"];
  const THEMES = {
    dark: {
      top: "#124a66", bottom: "#061a2c", ink: "#f2f9ff", faint: "rgba(170, 210, 232, 0.75)",
      ghost: "120, 196, 236", link: "#d5e6ef", edge: "rgba(4, 18, 32, 0.75)",
      jet: "235, 248, 255", speck: "190, 228, 245", done: "#8cf3ad",
      stone: "#334554", rim: "#94abb8",
    },
    light: {
      top: "#dff6fb", bottom: "#9fd8e8", ink: "#06283c", faint: "rgba(8, 58, 84, 0.8)",
      ghost: "9, 96, 138", link: "#f8fdff", edge: "rgba(6, 52, 78, 0.7)",
      jet: "255, 255, 255", jetEdge: "6, 70, 105", speck: "255, 255, 255", done: "#00693a",
      stone: "#7d919c", rim: "#eef5f8",
    },
  };
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const still = window.matchMedia("(prefers-reduced-motion: reduce)");
  const theme = () => (dark.matches ? THEMES.dark : THEMES.light);

  const known = PLACES.map((c) => [1, 3, 5].map((i) => parseInt(c.slice(i, i + 2), 16)));
  function placeColour(place) {
    const at = Math.min(Math.max(place, 0), 1) * (known.length - 1);
    const first = Math.min(Math.floor(at), known.length - 2), part = at - first;
    const mix = known[first].map((v, i) => Math.round(v + part * (known[first + 1][i] - v)));
    return `rgb(${mix.join(",")})`;
  }

  // Sees the world turned by an angle (rad, anticlockwise).
  class Camera {
    constructor() { this.x = 0; this.y = 0; this.scale = 400; this.turn = 0; this.box = [0, 0, 1, 1]; }
    turned(x, y, turn = this.turn) {
      const cos = Math.cos(turn), sin = Math.sin(turn);
      return [cos * x - sin * y, sin * x + cos * y];
    }
    toScreen(x, y) {
      const [left, top, width, height] = this.box, [u, v] = this.turned(x - this.x, y - this.y);
      return [left + width / 2 + u * this.scale, top + height / 2 - v * this.scale];
    }
    toWorld(px, py) {
      const [left, top, width, height] = this.box;
      const u = (px - left - width / 2) / this.scale, v = (top + height / 2 - py) / this.scale;
      const [x, y] = this.turned(u, v, -this.turn);
      return [x + this.x, y + this.y];
    }
    zoom(factor, px, py) {
      const before = this.toWorld(px, py);
      this.scale = Math.min(Math.max(this.scale * factor, 8), 6000);
      const after = this.toWorld(px, py);
      this.x += before[0] - after[0];
      this.y += before[1] - after[1];
    }
    pan(dx, dy) {
      const [x, y] = this.turned(dx / this.scale, -dy / this.scale, -this.turn);
      this.x -= x;
      this.y -= y;
    }
    // Where all points are seen, with a margin in metres.
    whole(points, margin = 0.15, most = 900) {
      let [left, low, right, high] = [Infinity, Infinity, -Infinity, -Infinity];
      for (const [px, py] of points) {
        const [x, y] = this.turned(px, py);
        left = Math.min(left, x); right = Math.max(right, x);
        low = Math.min(low, y); high = Math.max(high, y);
      }
      if (!(right >= left)) return { x: 0, y: 0, scale: 400 };
      const [, , width, height] = this.box;
      const scale = Math.min(width / (right - left + 2 * margin), height / (high - low + 2 * margin));
      const [x, y] = this.turned((left + right) / 2, (low + high) / 2, -this.turn);
      return { x, y, scale: Math.min(scale, most) };
    }
    fit(points, margin) { Object.assign(this, this.whole(points, margin)); }
  }

  // Sizes a canvas to its place on the page; true if that changed.
  function resize(canvas) {
    const ratio = window.devicePixelRatio || 1, { clientWidth: w, clientHeight: h } = canvas;
    if (canvas.width === Math.round(w * ratio) && canvas.height === Math.round(h * ratio)) {
      return false;
    }
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
    canvas.getContext("2d").setTransform(ratio, 0, 0, ratio, 0, 0);
    return true;
  }

  const scatter = (i, salt) => Math.abs(Math.sin(i * 127.1 + salt) * 43758.5453) % 1;
  const specks = Array.from({ length: 60 }, (_, i) => ({
    x: scatter(i, 1), y: scatter(i, 2), near: 0.25 + 0.75 * scatter(i, 3),
  }));

  // Water with specks that drift with the current (m/s) and lag behind the camera as it pans.
  function water(ctx, camera, seconds, current = [0, 0]) {
    const [left, top, width, height] = camera.box, look = theme();
    const fill = ctx.createLinearGradient(left, top, left + 0.25 * width, top + height);
    fill.addColorStop(0, look.top);
    fill.addColorStop(1, look.bottom);
    ctx.fillStyle = fill;
    ctx.fillRect(left, top, width, height);
    const time = still.matches ? 0 : seconds, [cameraX, cameraY] = camera.turned(camera.x, camera.y);
    for (const speck of specks) {
      const wander = 0.02 * Math.sin(time * 0.5 + 40 * speck.x);
      const shift = camera.scale * speck.near * 0.5;
      const x = speck.x * width + (current[0] * time - cameraX + wander) * shift;
      const y = speck.y * height + (cameraY - current[1] * time + 0.6 * wander) * shift;
      const [px, py] = [((x % width) + width) % width, ((y % height) + height) % height];
      ctx.fillStyle = `rgba(${look.speck}, ${0.10 + 0.22 * speck.near})`;
      ctx.beginPath();
      ctx.arc(left + px, top + py, 0.6 + 1.5 * speck.near, 0, 7);
      ctx.fill();
    }
  }

  function trace(ctx, camera, points) {
    ctx.beginPath();
    points.forEach(([x, y], i) => {
      const [px, py] = camera.toScreen(x, y);
      if (i && !points[i - 1].cut) ctx.lineTo(px, py); else ctx.moveTo(px, py);
    });
  }

  function stroke(ctx, colour, width) {
    ctx.lineCap = ctx.lineJoin = "round";
    ctx.strokeStyle = colour;
    ctx.lineWidth = width;
    ctx.stroke();
  }

  function boxAt(ctx, camera, x, y, angle, grow = 0) {
    const [px, py] = camera.toScreen(x, y), s = camera.scale;
    const [w, h] = sizes.unit.map((side) => side * s + grow);
    ctx.save();
    ctx.translate(px, py);
    ctx.rotate(-angle - camera.turn);
    ctx.beginPath();
    ctx.roundRect(-w / 2, -h / 2, w, h, CORNER * Math.min(...sizes.unit) * s + grow / 2);
    ctx.restore();
  }

  // The band in which the goal counts, and a ghost of each unit.
  function ghosts(ctx, camera, target, units, strength = 1) {
    const look = theme(), s = own(camera);
    trace(ctx, camera, target);
    stroke(ctx, `rgba(${look.ghost}, ${0.15 * strength})`, 2 * REACHED * s);
    stroke(ctx, `rgba(${look.ghost}, ${0.5 * strength})`, Math.max(1, 0.004 * s));
    ctx.fillStyle = `rgba(${look.ghost}, ${0.4 * strength})`;
    target.forEach(([x, y], i) => {
      boxAt(ctx, camera, x, y, units[i] ? units[i].angle : 0);
      ctx.fill();
    });
  }

  // Faint lines from units to their target points.
  function strings(ctx, camera, target, units) {
    const count = Math.min(target.length, units.length);
    ctx.beginPath();
    for (let i = 0; i < count; i++) {
      ctx.moveTo(...camera.toScreen(units[i].x, units[i].y));
      ctx.lineTo(...camera.toScreen(...target[i]));
    }
    stroke(ctx, `rgba(${theme().ghost}, 0.3)`, Math.max(0.8, 0.003 * own(camera)));
  }

  // The way of the centroid, brightest where it was last.
  function trail(ctx, camera, points) {
    const look = theme(), width = Math.max(1.5, 0.012 * own(camera));
    for (const [part, alpha] of [[1, 0.12], [0.5, 0.14], [0.25, 0.18], [0.1, 0.22]]) {
      const recent = points.slice(Math.floor(points.length * (1 - part)));
      if (recent.length < 2) continue;
      trace(ctx, camera, recent);
      stroke(ctx, `rgba(${look.jet}, ${alpha})`, width);
    }
  }

  // How long a jet is, of that of 1 N: the root of the thrust, so that small ones near the target
  // are seen; zero stays zero.
  function jetSize(thrust) {
    const strength = Math.abs(thrust);
    return strength < FAINTEST ? 0 : Math.max(Math.sqrt(strength), SHORTEST_JET);
  }

  // A jet leaves opposite to the push; it flickers a little while time goes on.
  function jet(ctx, camera, unit, seconds) {
    const size = jetSize(unit.thrust), s = own(camera), look = theme();
    if (!size) return;
    const flicker = still.matches ? 1 : 1 + 0.12 * Math.sin(31 * seconds + 9 * unit.place * 40);
    const [px, py] = camera.toScreen(unit.x, unit.y), side = Math.sign(unit.thrust);
    const rim = sizes.unit[1] / 2 * camera.scale - 0.003 * s, reach = JET * size * flicker * s;
    ctx.save();
    ctx.translate(px, py);
    ctx.rotate(-unit.angle - camera.turn);
    ctx.scale(1, side);
    const fade = ctx.createLinearGradient(0, rim, 0, rim + reach);
    fade.addColorStop(0, `rgba(${look.jet}, 0.95)`);
    fade.addColorStop(1, `rgba(${look.jet}, 0)`);
    const edge = () => { // on light water white alone would not be seen
      const line = ctx.createLinearGradient(0, rim, 0, rim + reach);
      line.addColorStop(0, `rgba(${look.jetEdge}, 0.9)`);
      line.addColorStop(1, `rgba(${look.jetEdge}, 0.25)`);
      stroke(ctx, line, 1);
    };
    for (const [wide, alpha] of [[1.4, 0.35], [0.7, 0.9]]) {
      const half = 0.011 * s * wide * (0.4 + 0.6 * size);
      ctx.globalAlpha = alpha;
      ctx.fillStyle = fade;
      ctx.beginPath();
      ctx.moveTo(-0.7 * half, rim);
      ctx.bezierCurveTo(-1.6 * half, rim + 0.5 * reach, -0.5 * half, rim + reach, 0, rim + reach);
      ctx.bezierCurveTo(0.5 * half, rim + reach, 1.6 * half, rim + 0.5 * reach, 0.7 * half, rim);
      ctx.fill();
      if (look.jetEdge && wide > 1) edge();
    }
    ctx.restore();
  }

  // The line along a chain: through its units, or from hinge to hinge where they are rigid links.
  function lineOf(units) {
    if (units[0]?.mount !== undefined) {
      const end = ({ x, y, angle, mount }, way) => [
        x + way * sizes.link / 2 * Math.cos(angle - mount), y + way * sizes.link / 2 * Math.sin(angle - mount)];
      return [end(units[0], -1), ...units.map((unit) => end(unit, 1))];
    }
    return units.flatMap((unit) => (unit.cut // its link hangs on in its own direction
      ? [[unit.x, unit.y], Object.assign([unit.x + 0.07 * Math.cos(unit.angle), unit.y + 0.07 * Math.sin(unit.angle)], { cut: true })]
      : [[unit.x, unit.y]]));
  }

  // units: {x, y, angle, thrust, place in [0, 1], off, marked, mount}
  function chain(ctx, camera, units, seconds) {
    const look = theme(), s = own(camera);
    units.forEach((unit) => jet(ctx, camera, unit, seconds));
    trace(ctx, camera, lineOf(units));
    stroke(ctx, look.edge, Math.max(3, 0.02 * s));
    stroke(ctx, look.link, Math.max(1.6, 0.012 * s));
    for (const unit of units) {
      boxAt(ctx, camera, unit.x, unit.y, unit.angle, Math.max(1, 0.004 * s));
      ctx.fillStyle = look.edge;
      ctx.fill();
      boxAt(ctx, camera, unit.x, unit.y, unit.angle);
      ctx.fillStyle = placeColour(unit.place);
      ctx.fill();
      if (s > 250) shine(ctx, camera, unit);
      if (unit.off) cross(ctx, camera, unit);
      if (unit.marked) {
        boxAt(ctx, camera, unit.x, unit.y, unit.angle, 9);
        stroke(ctx, look.ink, 2);
      }
    }
  }

  function shine(ctx, camera, unit) {
    const [px, py] = camera.toScreen(unit.x, unit.y), s = own(camera);
    const glow = ctx.createRadialGradient(px - 0.008 * s, py - 0.012 * s, 0, px, py, 0.03 * s);
    glow.addColorStop(0, "rgba(255, 255, 255, 0.75)");
    glow.addColorStop(0.45, "rgba(255, 255, 255, 0.10)");
    glow.addColorStop(1, "rgba(0, 20, 40, 0.22)");
    boxAt(ctx, camera, unit.x, unit.y, unit.angle);
    ctx.fillStyle = glow;
    ctx.fill();
  }

  // A unit whose thruster is off.
  function cross(ctx, camera, unit) {
    const [px, py] = camera.toScreen(unit.x, unit.y), r = Math.max(3, 0.016 * own(camera));
    boxAt(ctx, camera, unit.x, unit.y, unit.angle);
    ctx.fillStyle = "rgba(20, 30, 40, 0.55)";
    ctx.fill();
    ctx.beginPath();
    ctx.moveTo(px - r, py - r); ctx.lineTo(px + r, py + r);
    ctx.moveTo(px - r, py + r); ctx.lineTo(px + r, py - r);
    stroke(ctx, "#fff", Math.max(1.5, 0.006 * own(camera)));
  }

  function scaleBar(ctx, camera) {
    const [left, top, width, height] = camera.box, look = theme();
    const room = Math.min(width / 5, 180) / camera.scale, power = 10 ** Math.floor(Math.log10(room));
    const length = power * [5, 2, 1].find((k) => k * power <= room * (1 + 1e-9));
    const [right, low] = [left + width - 16, top + height - 16], size = length * camera.scale;
    ctx.beginPath();
    ctx.moveTo(right - size, low - 4); ctx.lineTo(right - size, low + 4);
    ctx.moveTo(right - size, low); ctx.lineTo(right, low);
    ctx.moveTo(right, low - 4); ctx.lineTo(right, low + 4);
    stroke(ctx, look.ink, 1.5);
    ctx.fillStyle = look.ink;
    ctx.font = "12px system-ui, sans-serif";
    ctx.textAlign = "right";
    const name = length >= 1 ? `${+length.toPrecision(1)} m` : `${+(100 * length).toPrecision(1)} cm`;
    ctx.fillText(name, right - size - 8, low + 4);
    ctx.textAlign = "left";
  }

  // Dragging with one pointer, pinching with two, the wheel. `grab` may take a drag for itself by
  // returning {move(x, y), end()}; otherwise the camera pans. What it returns may take a second
  // finger, too: where second(x, y) says so, hold(x, y) and then twist(x, y, turn) get the middle
  // between both fingers and by how much they have turned (rad, anticlockwise).
  function pointers(canvas, cameraAt, grab = () => null, moved = () => {}) {
    const down = new Map();
    let taken = null;
    const half = ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
    const bearing = (a, b) => Math.atan2(b[1] - a[1], b[0] - a[0]);
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      const at = place(event);
      down.set(event.pointerId, at);
      if (down.size === 1) taken = grab(...at, event);
      else if (down.size === 2 && taken?.second?.(...at)) taken.hold(...half([...down.values()]));
      else if (taken) { taken.end(); taken = null; }
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = down.get(event.pointerId), at = place(event);
      if (!before) return;
      down.set(event.pointerId, at);
      if (taken && down.size === 2) {
        const [other] = [...down].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
        taken.twist(...half([at, other]), betweenAngles(0, bearing(other, before) - bearing(other, at), 1));
        return;
      }
      if (taken) { taken.move(...at); return; }
      const camera = cameraAt(...at);
      if (down.size === 2) {
        const [other] = [...down].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
        const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
        camera.zoom(gap(at) / Math.max(gap(before), 1), (at[0] + other[0]) / 2, (at[1] + other[1]) / 2);
        camera.pan((at[0] - before[0]) / 2, (at[1] - before[1]) / 2);
      } else camera.pan(at[0] - before[0], at[1] - before[1]);
      moved(camera);
    });
    const up = (event) => {
      down.delete(event.pointerId);
      if (taken) { taken.end(); taken = null; down.clear(); } // a finger that is left does nothing
    };
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const camera = cameraAt(...place(event));
      camera.zoom(Math.exp(-event.deltaY / 400), ...place(event));
      moved(camera);
    }, { passive: false });
  }

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer; // of base64
  const between = (a, b, part) => a + part * (b - a);
  function betweenAngles(a, b, part) {
    const apart = ((b - a + Math.PI) % (2 * Math.PI) + 2 * Math.PI) % (2 * Math.PI) - Math.PI;
    return a + part * apart;
  }

  return {
    REACHED, Camera, between, betweenAngles, bytes, chain, dark, ghosts, jetSize, placeColour, pointers, resize,
    scaleBar, sizes, still, strings, theme, trail, water, trace, stroke,
  };
})();
