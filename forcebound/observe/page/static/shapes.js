// Shapes of a scene: vectors, where an object is, and the faces that it has.

const LIGHT = [0.4, -0.5, 0.77]; // from where it comes
const PLANE = 0.1; // m, half of the edge of what is drawn of a plane

export const add = (a, b) => a.map((x, i) => x + b[i]);
export const sub = (a, b) => a.map((x, i) => x - b[i]);
export const scaled = (a, f) => a.map((x) => x * f);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const pad = (a) => [a?.[0] ?? 0, a?.[1] ?? 0, a?.[2] ?? 0];

const CORNERS = [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => [-1, 1].map((z) => [x / 2, y / 2, z / 2])));
const BOX_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
export const BOX_EDGES = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/** The corners of a box about `middle`, in the order in which its edges and faces name them. */
export const boxCorners = (middle, size) => CORNERS.map((corner) => corner.map((x, i) => middle[i] + x * size[i]));

function turned([w, x, y, z], a) {
  const axis = [x, y, z], twice = scaled(cross(axis, a), 2);
  return add(add(a, scaled(twice, w)), cross(axis, twice));
}

/** What takes a point from an object's own axes into the world. */
export function placeOf({ position = [0, 0, 0], orientation = [1, 0, 0, 0] }) {
  return (point) => add(position, turned(orientation, point));
}

const round = (count, at) => Array.from({ length: count }, (_, i) => at((2 * Math.PI * i) / count));

const SIZES = { box: 3, cylinder: 2, sphere: 1 }; // lengths that each has
const FACES = { // in the object's own axes
  plane: () => [[[-PLANE, -PLANE, 0], [PLANE, -PLANE, 0], [PLANE, PLANE, 0], [-PLANE, PLANE, 0]]],
  box({ size }) {
    const corners = boxCorners([0, 0, 0], size);
    return BOX_FACES.map((face) => face.map((i) => corners[i]));
  },
  cylinder({ size: [radius, length] }, _, fine = 1) {
    const many = 24 * fine, rim = (z) => round(many, (t) => [radius * Math.cos(t), radius * Math.sin(t), z]);
    const low = rim(-length / 2), high = rim(length / 2);
    return [low, high, ...low.map((p, i) => [p, low[(i + 1) % many], high[(i + 1) % many], high[i]])];
  },
  sphere({ size: [radius] }, _, fine = 1) {
    const faces = [], rows = 8 * fine, count = 16 * fine, step = (2 * Math.PI) / count;
    const at = (i, t) => [Math.sin((Math.PI * i) / rows) * Math.cos(t), Math.sin((Math.PI * i) / rows) * Math.sin(t),
      Math.cos((Math.PI * i) / rows)].map((x) => radius * x);
    for (let i = 0; i < rows; i += 1) {
      round(count, (t) => faces.push([at(i, t), at(i + 1, t), at(i + 1, t + step), at(i, t + step)]));
    }
    return faces;
  },
  mesh: (_, file) => divided(file?.corners ?? []),
};

/** Triangles without the large ones, which are cut: painters sort by depth, and need faces of like size. */
function divided(triangles) {
  const edges = ([a, b, c]) => [[b, c], [c, a], [a, b]].map(([p, q]) => Math.hypot(...sub(p, q)));
  const limit = 2 * triangles.reduce((sum, each) => sum + Math.max(...edges(each)) / triangles.length, 0);
  const cut = (each) => {
    const lengths = edges(each), longest = Math.max(...lengths), i = lengths.indexOf(longest);
    if (longest <= limit) return [each];
    const [a, b, c] = [0, 1, 2].map((k) => each[(i + k) % 3]), middle = scaled(add(b, c), 0.5);
    return [...cut([a, b, middle]), ...cut([a, middle, c])];
  };
  return triangles.flatMap(cut);
}

/** The triangles of an object in its own axes, finer than its faces where it is round. */
export function trianglesOf(object, file) {
  if ((object.size ?? []).length < (SIZES[object.shape] ?? 0)) return []; // an environment may leave it out
  const faces = object.shape === "mesh" ? file?.corners : FACES[object.shape]?.(object, file, 3);
  return (faces ?? []).flatMap((points) => points.slice(2).map((point, i) => [points[0], points[i + 1], point]));
}

/** The point of a triangle closest to a place. Source: C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5. */
export function closest(p, [a, b, c]) {
  const ab = sub(b, a), ac = sub(c, a), ap = sub(p, a), d1 = dot(ab, ap), d2 = dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const bp = sub(p, b), d3 = dot(ab, bp), d4 = dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return add(a, scaled(ab, d1 / (d1 - d3)));
  const cp = sub(p, c), d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return add(a, scaled(ac, d2 / (d2 - d6)));
  const va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) return add(b, scaled(sub(c, b), (d4 - d3) / (d4 - d3 + d5 - d6)));
  return add(a, add(scaled(ab, vb / (va + vb + vc)), scaled(ac, vc / (va + vb + vc))));
}

/** A face and how bright it is. */
function lit(points) {
  const normal = cross(sub(points[1], points[0]), sub(points[2], points[0]));
  return { points, light: Math.abs(dot(normal, LIGHT)) / (Math.hypot(...normal) || 1) };
}

/** The faces of an object in the world; `file`: what its file has, if that is here. */
export function facesOf(object, file) {
  if ((object.size ?? []).length < (SIZES[object.shape] ?? 0)) return []; // an environment may leave it out
  const place = placeOf(object);
  return (FACES[object.shape]?.(object, file) ?? []).map((face) => lit(face.map(place)));
}

/** The points of an object in the world: of a path, or of a cloud. */
export function pointsOf(object, file) {
  return ((object.shape === "path" ? object.points : file?.points) ?? []).map(placeOf(object));
}
