// The objects of a scene, drawn by the graphics card: lit, with the tips among them and their shadows.
// The view is the same parallel one as that of the canvas above, so a place has the same pixel in both.

import { sizeOf } from "./canvas.js";
import { BOX_EDGES, boxCorners, trianglesOf } from "./shapes.js";

const CREASE = 0.6; // cosine of the angle between two faces, from which on their edge looks sharp
const MOST_TIPS = 8; // that cast a shadow
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i; // browsers have it in place of a card
const BALL = 8; // pixels, radius of a tip

const VERTEX = `#version 300 es
in vec3 place, normal;
uniform vec3 at, centre, right, up, forward, size;
uniform vec4 turn;
uniform vec2 scale;
out vec3 world, facing, own;
vec3 turned(vec3 a) { vec3 twice = 2.0 * cross(turn.yzw, a); return a + turn.x * twice + cross(turn.yzw, twice); }
void main() {
  own = place * size;
  world = at + turned(own);
  facing = turned(normal);
  vec3 from = world - centre;
  gl_Position = vec4(dot(from, right) * scale.x, dot(from, up) * scale.y, dot(from, forward) / 5.0, 1.0);
}`;

// A key light from above and the left of the eye, a sky, and a rim, so that what turns away is seen. The shadow of a tip
// falls straight down, since only then its distance can be read.
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 world, facing, own;
uniform vec3 right, up, forward, colour, tips[${MOST_TIPS}];
uniform int count;
uniform float radius, grid, alpha;
out vec4 result;
void main() {
  vec3 n = normalize(facing);
  float edge = dot(n, forward);
  if (edge > 0.0) n = -n;
  float key = max(dot(n, normalize(0.9 * up - 0.7 * forward - 0.5 * right)), 0.0), sky = 0.5 + 0.5 * n.z;
  float rim = pow(1.0 - abs(edge), 3.0);
  float light = grid > 0.0 ? 1.0 : 0.36 + 0.5 * key + 0.2 * sky + 0.12 * rim;
  for (int i = 0; i < count; i += 1) {
    vec3 to = tips[i] - world;
    float wide = radius * 1.5 + 0.12 * max(to.z, 0.0);
    if (to.z > -0.5 * radius && n.z > -0.2) light *= 1.0 - 0.5 * radius / wide * 1.5 * smoothstep(wide, 0.35 * wide, length(to.xy));
  }
  float line = 0.0, opacity = alpha;
  if (grid > 0.0) {
    vec2 cell = own.xy / grid, near = abs(fract(cell - 0.5) - 0.5) / fwidth(cell);
    line = 1.0 - min(min(near.x, near.y), 1.0);
    opacity = max(alpha, 0.28 * line) + 0.75 * (1.0 - light);
  }
  vec3 shade = colour * light * (1.0 - 0.35 * line);
  result = vec4(min(shade, 1.0) * opacity, opacity);
}`;

/** Corners of triangles with a normal each: the mean of the faces at the corner, but not over sharp edges. */
function shaded(triangles) {
  const at = new Map(), faces = [], places = [], normals = [];
  for (const [a, b, c] of triangles) {
    const [ux, uy, uz] = [b[0] - a[0], b[1] - a[1], b[2] - a[2]], [vx, vy, vz] = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], length = Math.hypot(...normal);
    if (length === 0) continue;
    const face = { corners: [a, b, c], normal, length }; // as long as twice its area: large faces count more
    face.keys = face.corners.map((p) => p.map((x) => Math.round(1e7 * x)).join());
    for (const key of face.keys) if (!at.has(key)) at.set(key, [face]); else at.get(key).push(face);
    faces.push(face);
  }
  for (const { corners, normal, length, keys } of faces) {
    corners.forEach((corner, i) => {
      const sum = [0, 0, 0];
      for (const other of at.get(keys[i])) {
        const along = other.normal[0] * normal[0] + other.normal[1] * normal[1] + other.normal[2] * normal[2];
        if (along > CREASE * length * other.length) for (const k of [0, 1, 2]) sum[k] += other.normal[k];
      }
      places.push(...corner);
      normals.push(...sum);
    });
  }
  return { places, normals };
}

/** Whether the card draws an object; cut-outs, paths and clouds are left to the painter. */
export const isDrawable = ({ shape, is_removed }) => !is_removed && !["path", "points"].includes(shape);

/** The edges of a box of 1 m. */
function edges() {
  const places = BOX_EDGES.flat().flatMap((i) => boxCorners([0, 0, 0], [1, 1, 1])[i]);
  return { places, normals: places.map((_, i) => Number(i % 3 === 2)) };
}

/** A canvas of the graphics card behind another one. */
export class Solids {
  /** The objects' canvas behind `above`; null: there is no graphics card. Software in its place takes time from the ticks. */
  static behind(above) {
    const canvas = document.createElement("canvas"), gl = canvas.getContext("webgl2", { failIfMajorPerformanceCaveat: true });
    if (!gl || SOFTWARE.test(gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER))) return null;
    above.before(canvas);
    return new Solids(canvas, gl);
  }

  constructor(canvas, gl) {
    Object.assign(this, { canvas, gl, isLost: false });
    canvas.setAttribute("aria-hidden", "true");
    canvas.addEventListener("webglcontextlost", (event) => { event.preventDefault(); this.isLost = true; });
    canvas.addEventListener("webglcontextrestored", () => { this.isLost = false; this.begin(); });
    this.begin();
  }

  begin() {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.program = program;
    this.places = new Map(); // of uniforms
    this.kept = new Map(); // what a shape has on the card, by what it is
    this.shown = null;
  }

  uniform(name) {
    if (!this.places.has(name)) this.places.set(name, this.gl.getUniformLocation(this.program, name));
    return this.places.get(name);
  }

  vector(name, values) { this.gl[`uniform${values.length}f`](this.uniform(name), ...values); }

  /** The triangles of a shape on the card; a moved object needs no others. */
  shape(object, file) {
    const key = object.digest ?? JSON.stringify([object.shape, object.size]), { gl } = this;
    if (!this.kept.has(key)) {
      const { places, normals } = object.shape === "edges" ? edges() : shaded(trianglesOf(object, file)), array = gl.createVertexArray();
      gl.bindVertexArray(array);
      for (const [name, values] of [["place", places], ["normal", normals]]) {
        const at = gl.getAttribLocation(this.program, name);
        gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STATIC_DRAW);
        gl.enableVertexAttribArray(at);
        gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
      }
      this.kept.set(key, { array, count: places.length / 3 });
    }
    return this.kept.get(key);
  }

  one(object, file, colour, { size = [1, 1, 1], alpha = 1, grid = 0 } = {}) {
    const { array, count } = this.shape(object, file), { gl } = this;
    if (!count) return;
    this.vector("at", object.position ?? [0, 0, 0]);
    this.vector("turn", object.orientation ?? [1, 0, 0, 0]);
    this.vector("size", size);
    this.vector("colour", colour);
    gl.uniform1f(this.uniform("alpha"), alpha);
    gl.uniform1f(this.uniform("grid"), grid);
    gl.bindVertexArray(array);
    gl.drawArrays(object.shape === "edges" ? gl.LINES : gl.TRIANGLES, 0, count);
  }

  /** Draw objects and tips, if they or the view have changed. `view`: right, up, forward, scale in pixels for each metre. */
  draw({ boxes, objects, files, centre, view, tips, isDark }) {
    const { gl, canvas } = this, ratio = window.devicePixelRatio || 1, [width, height] = sizeOf(canvas);
    const ready = objects.filter(({ digest }) => !digest || files.has(digest));
    const shown = JSON.stringify([boxes, ready, centre, view, tips, isDark, width, height, ratio]);
    if (shown === this.shown || this.isLost) return;
    this.shown = shown;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    }
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    for (const [name, value] of Object.entries({ centre, right: view.right, up: view.up, forward: view.forward })) this.vector(name, value);
    this.vector("scale", [(2 * view.scale) / width, (2 * view.scale) / height]);
    const radius = BALL / view.scale, casting = tips.slice(0, MOST_TIPS);
    gl.uniform1f(this.uniform("radius"), radius);
    gl.uniform1i(this.uniform("count"), casting.length);
    if (casting.length) gl.uniform3fv(this.uniform("tips"), casting.flatMap(({ place }) => place));
    const fixed = isDark ? [0.5, 0.56, 0.63] : [0.72, 0.77, 0.82], free = isDark ? [0.76, 0.6, 0.36] : [0.92, 0.74, 0.47];
    const flat = ready.filter(({ shape }) => shape === "plane");
    for (const object of ready) if (!flat.includes(object)) this.one(object, files.get(object.digest), object.is_fixed === false ? free : fixed);
    gl.uniform1i(this.uniform("count"), 0);
    for (const { position, size } of boxes) this.one({ shape: "edges", position }, null, isDark ? [0.25, 0.31, 0.36] : [0.8, 0.83, 0.86], { size });
    // A tip has no shadow on itself.
    for (const { place, colour } of tips) this.one({ shape: "sphere", size: [1], position: place }, null, colour, { size: [radius, radius, radius] });
    gl.uniform1i(this.uniform("count"), casting.length);
    gl.depthMask(false);
    for (const object of flat) this.one(object, null, isDark ? [0.45, 0.52, 0.6] : [0.5, 0.56, 0.62], { alpha: 0.12, grid: 0.01 });
    gl.depthMask(true);
  }
}
