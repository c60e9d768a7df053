// The weights of a policy that `salpchain export --format onnx` wrote. No runtime: the file's own
// layers are its products with constants, in their order, and its metadata says what network they are.
"use strict";
const Onnx = (() => {
  const TEXT = new TextDecoder("utf-8", { fatal: true });

  /** The fields of a protobuf message: [number, value], where a value is a number or bytes. */
  function* fields(bytes) {
    let at = 0;
    const varint = () => {
      let [value, scale] = [0, 1];
      for (;;) {
        if (at >= bytes.length || scale > 2 ** 63) throw new RangeError("cut short");
        const byte = bytes[at++];
        value += (byte & 127) * scale;
        if (byte < 128) return value;
        scale *= 128;
      }
    };
    while (at < bytes.length) {
      const tag = varint(), kind = tag % 8, number = Math.floor(tag / 8);
      if (kind === 0) { yield [number, varint()]; continue; }
      const size = kind === 2 ? varint() : { 1: 8, 5: 4 }[kind];
      if (size === undefined || at + size > bytes.length) throw new RangeError("cut short");
      yield [number, bytes.subarray(at, at += size)];
    }
  }

  const all = (bytes, number) => [...fields(bytes)].filter(([k]) => k === number).map(([, value]) => value);
  const text = (bytes, number) => TEXT.decode(all(bytes, number)[0] ?? new Uint8Array());

  /** The dimensions of a tensor; they may be packed into one field. */
  function dimensions(bytes) {
    return all(bytes, 1).flatMap((value) => {
      if (typeof value === "number") return [value];
      const shape = [];
      for (let k = 0, part = 0, scale = 1; k < value.length; k++) {
        part += (value[k] & 127) * scale; scale *= 128;
        if (value[k] < 128) { shape.push(part); [part, scale] = [0, 1]; }
      }
      return shape;
    });
  }

  function tensor(bytes) {
    const shape = dimensions(bytes), raw = all(bytes, 9)[0], count = shape.reduce((product, side) => product * side, 1);
    if (all(bytes, 2)[0] !== 1 || !raw || raw.length !== 4 * count) return null; // no float32
    const view = new DataView(raw.buffer, raw.byteOffset, raw.length);
    return { shape, values: Float64Array.from({ length: count }, (_, i) => view.getFloat32(4 * i, true)) };
  }

  /** Layers in the order in which they act: a product with a constant, and the sum that follows. */
  function layers(graph, made) {
    const constants = new Map(all(graph, 5).map((one) => [text(one, 8), tensor(one)]));
    const nodes = all(graph, 1).map((one) => ({
      kind: text(one, 4), inputs: all(one, 1).map((name) => TEXT.decode(name)), output: text(one, 2),
    }));
    return nodes.filter(({ kind, inputs }) => kind === "MatMul" && constants.get(inputs[1])?.shape.length === 2)
      .map(({ inputs, output }) => {
        const sum = nodes.find((node) => node.kind === "Add" && node.inputs[0] === output);
        return made(constants.get(inputs[1]), constants.get(sum?.inputs[1]), output);
      });
  }

  /** The graph of a file and what its metadata says; throws a RangeError where it is cut short. */
  function parsed(buffer) {
    const bytes = new Uint8Array(buffer), graph = all(bytes, 7)[0];
    const about = Object.fromEntries(all(bytes, 14).map((one) => [text(one, 1), text(one, 2)]));
    if (!graph) throw new RangeError("no graph");
    return { about, graph };
  }

  /** @returns the policy; `of` has what `policy.js` checks with */
  function policy(buffer, of) {
    const { Refusal, assembled, checkServed, layer } = of;
    try {
      const { about, graph } = parsed(buffer);
      if (!about.observation || !about.model) throw new Refusal("This ONNX file was not written by salpchain export.");
      checkServed(about);
      const found = layers(graph, layer), depth = Number(about.depth);
      if (found.length !== depth + 3) throw new Refusal("The layers of this policy do not fit what its header says of it.");
      return assembled({ ...about, improved: about.improved === "true" }, found.slice(0, depth), found.slice(depth));
    } catch (error) {
      if (error instanceof Refusal) throw error;
      throw new Refusal("This is neither a policy.safetensors of salpchain nor an ONNX file that is whole.");
    }
  }

  return { policy };
})();
