// What is around a chain on the page: walls and posts (m), and streaks that drift with the water.
"use strict";
const Surroundings = (() => {
  const LIFE = 6, TAIL = 3, FADE = 1.5, PIECES = 6; // s, s, s, of a streak (as in surroundings.py)
  const APART = 60; // pixels between two streaks
  const scatter = (number, salt) => Math.abs(Math.sin(number * 127.1 + 311.7 * salt) * 43758.5453) % 1;

  // Gives a swim `flow(x, y, part)`: the water's velocity (m/s) when this part of it is over.
  function unpack(swim, numbers) {
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

  // The way of one speck since it began, its last seconds alone.
  function way(swim, camera, [px, py], index, time) {
    const turns = time / LIFE + scatter(index, 3), turn = Math.floor(turns), age = (turns - turn) * LIFE;
    const [jx, jy] = [1, 2].map((salt) => (scatter(index + 7919 * turn, salt) - 0.5) * APART);
    const part = time / Math.max(swim.steps * swim.dt, 1e-9), step = age / (2 * PIECES);
    const points = [camera.toWorld(px + jx, py + jy)];
    for (let k = 0; k < 2 * PIECES; k++) {
      const [x, y] = points[k], [u, v] = swim.flow(x, y, part);
      points.push([x + step * u, y + step * v]);
    }
    const length = Math.min(TAIL, age) * Math.min((LIFE - age) / FADE, 1);
    const first = Math.floor((1 - length / Math.max(age, 1e-9)) * 2 * PIECES);
    return points.slice(Math.max(first, 0));
  }

  function streaks(ctx, swim, time) {
    if (!swim.flow) return;
    const { camera } = swim, [left, top, width, height] = camera.box, { ghost } = Salp.theme();
    const columns = Math.ceil(width / APART), count = columns * Math.ceil(height / APART);
    for (let index = 0; index < count; index++) {
      const [column, row] = [index % columns, Math.floor(index / columns)];
      const start = [left + (column + 0.5) * APART, top + (row + 0.5) * APART];
      const points = way(swim, camera, start, index, time);
      for (const [share, alpha] of [[0, 0.16], [0.5, 0.24]]) {
        Salp.trace(ctx, camera, points.slice(Math.floor(share * (points.length - 1))));
        Salp.stroke(ctx, `rgba(${ghost}, ${alpha})`, 1.5);
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
