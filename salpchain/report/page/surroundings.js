// What is around a chain on the page: walls and posts (m), and streaks that drift with the water.
"use strict";
const Surroundings = (() => {
  const LIFE = 6, TAIL = 3, FADE = 1.5, PIECES = 6; // s, s, s, of a streak (as in surroundings.py)
  const APART = 60; // pixels between two streaks, about
  const scatter = (number, salt) => Math.abs(Math.sin(number * 127.1 + 311.7 * salt) * 43758.5453) % 1;

  // Gives a swim `flow(x, y, part)`: the water's velocity (m/s) when this part of it is over.
  function unpack(swim) {
    if (!swim.water) return;
    const numbers = new Int8Array(Salp.bytes(swim.water.flow));
    const { shape: [moments, rows, columns], area: [low, high], speed } = swim.water;
    const at = (share, count) => {
      const place = Math.min(Math.max(share, 0), 1) * (count - 1), first = Math.floor(place);
      return [first, Math.min(first + 1, count - 1), place - first];
    };
    swim.flow = (x, y, part) => {
      const [m0, m1, m] = at(part, moments);
      const [c0, c1, c] = at((x - low[0]) / Math.max(high[0] - low[0], 1e-9), columns);
      const [r0, r1, r] = at((y - low[1]) / Math.max(high[1] - low[1], 1e-9), rows);
      return [0, 1].map((axis) => {
        const value = (k, i, j) => numbers[2 * ((k * rows + i) * columns + j) + axis] * speed / 127;
        const row = (k, i) => Salp.between(value(k, i, c0), value(k, i, c1), c);
        const moment = (k) => Salp.between(row(k, r0), row(k, r1), r);
        return Salp.between(moment(m0), moment(m1), m);
      });
    };
  }

  // The way of one speck since it began near a point (m), its last seconds alone.
  function way(swim, [x0, y0], apart, index, time) {
    const turns = time / LIFE + scatter(index, 3), turn = Math.floor(turns), age = (turns - turn) * LIFE;
    const [jx, jy] = [1, 2].map((salt) => (scatter(index + 7919 * turn, salt) - 0.5) * apart);
    const part = time / Math.max(swim.steps * swim.dt, 1e-9), step = age / (2 * PIECES);
    const points = [[x0 + jx, y0 + jy]];
    for (let k = 0; k < 2 * PIECES; k++) {
      const [x, y] = points[k], [u, v] = swim.flow(x, y, part);
      points.push([x + step * u, y + step * v]);
    }
    const length = Math.min(TAIL, age) * Math.min((LIFE - age) / FADE, 1);
    const first = Math.floor((1 - length / Math.max(age, 1e-9)) * 2 * PIECES);
    return points.slice(Math.max(first, 0));
  }

  // Each begins near a point of a grid that lies still in the world, however the view moves.
  function streaks(ctx, swim, time) {
    if (!swim.flow) return;
    const { camera } = swim, [left, top, width, height] = camera.box, { ghost } = Salp.theme();
    const apart = 2 ** Math.round(Math.log2(APART / camera.scale)); // m
    const seen = [[0, 0], [1, 0], [0, 1], [1, 1]].map(([i, j]) => camera.toWorld(left + i * width, top + j * height));
    const [columns, rows] = [0, 1].map((axis) => seen.map((point) => Math.round(point[axis] / apart)));
    for (let column = Math.min(...columns); column <= Math.max(...columns); column++) {
      for (let row = Math.min(...rows); row <= Math.max(...rows); row++) {
        const points = way(swim, [column * apart, row * apart], apart, column + 997 * row, time);
        for (const [share, alpha] of [[0, 0.16], [0.5, 0.24]]) {
          Salp.trace(ctx, camera, points.slice(Math.floor(share * (points.length - 1))));
          Salp.stroke(ctx, `rgba(${ghost}, ${alpha})`, 1.5);
        }
      }
    }
  }

  function wallCorners([ax, ay, bx, by, width]) {
    const length = Math.max(Math.hypot(bx - ax, by - ay), 1e-9);
    const [x, y] = [-(by - ay) / length * width / 2, (bx - ax) / length * width / 2];
    return [[ax - x, ay - y], [bx - x, by - y], [bx + x, by + y], [ax + x, ay + y]];
  }

  function postCorners([x, y, radius]) {
    return Array.from({ length: 48 }, (_, k) => k * Math.PI / 24)
      .map((angle) => [x + radius * Math.cos(angle), y + radius * Math.sin(angle)]);
  }

  const outlines = ({ walls = [], posts = [] }) => [...walls.map(wallCorners), ...posts.map(postCorners)];

  // The corners of what stands around a swim, but for what is far away.
  function corners(swim) {
    const [xs, ys] = [0, 1].map((axis) => [...swim.target, ...swim.centroid].map((point) => point[axis]));
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const margin = Math.max(right - left, high - low);
    return outlines(swim).flat().filter(([x, y]) => x >= left - margin && x <= right + margin
      && y >= low - margin && y <= high + margin);
  }

  // Walls and posts: the rims first, so that where two meet there is none.
  function draw(ctx, swim) {
    const { camera } = swim, look = Salp.theme(), rim = Math.max(1, 0.005 * camera.scale);
    const shapes = outlines(swim);
    for (const [colour, width] of [[look.edge, 5 * rim], [look.rim, 2 * rim]]) {
      for (const shape of shapes) {
        Salp.trace(ctx, camera, shape);
        ctx.closePath();
        Salp.stroke(ctx, colour, width);
      }
    }
    ctx.fillStyle = look.stone;
    for (const shape of shapes) {
      Salp.trace(ctx, camera, shape);
      ctx.fill();
    }
  }

  return { unpack, streaks, corners, draw };
})();
