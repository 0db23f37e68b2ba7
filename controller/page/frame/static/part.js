// A part in three dimensions: at rest in a stable pose, with balloons, or with what a plan shows of it.
// What a face is stands in its pattern as well as in its colour.
import {
  BufferAttribute, BufferGeometry, CanvasTexture, DoubleSide, GridHelper, Group, LineBasicMaterial,
  LineSegments, Matrix3, Matrix4, Mesh, MeshLambertMaterial, Points, PointsMaterial, Raycaster,
  RepeatWrapping, SRGBColorSpace, Sprite, SpriteMaterial, Vector2, Vector3,
} from "/static/three/three.module.min.js";
import { OrbitView } from "/static/orbit.js";

// By state of a face: colour, ink and pattern of its tile; the legend draws the same.
export const PATTERNS = {
  plain: ["#aebccb", "", "none"],
  chosen: ["#f2a33a", "#7a3d00", "stripes"],
  seen: ["#5b9bd8", "", "none"],
  partly: ["#a9d0f2", "#0d4c8a", "dots"],
  unseen: ["#e58a52", "#6b2400", "stripes"],
  left_out: ["#c9c9c9", "#4a4a4a", "crosses"],
  little: ["#cfe3f6", "#0d4c8a", "dots"],
  much: ["#8fc0ea", "#0d4c8a", "stripes"],
  most: ["#1c5a9e", "", "none"],
};
const TILE_PX = 64;
const TILES = 14; // along the part
const BALLOON_MAX = 60;

export function tile(state) {
  const [ground, ink, pattern] = PATTERNS[state];
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = TILE_PX;
  const pen = canvas.getContext("2d");
  pen.fillStyle = ground;
  pen.fillRect(0, 0, TILE_PX, TILE_PX);
  pen.fillStyle = pen.strokeStyle = ink || ground;
  pen.lineWidth = 9;
  const line = (x0, y0, x1, y1) => {
    pen.beginPath();
    pen.moveTo(x0, y0);
    pen.lineTo(x1, y1);
    pen.stroke();
  };
  const n = TILE_PX;
  if (pattern === "dots") {
    for (const [x, y] of [[n / 4, n / 4], [3 * n / 4, 3 * n / 4]]) {
      pen.beginPath();
      pen.arc(x, y, 9, 0, 7);
      pen.fill();
    }
  }
  if (pattern === "stripes" || pattern === "crosses") {
    for (const shift of [-n, 0, n]) line(shift - 8, n + 8, shift + n + 8, -8);
  }
  if (pattern === "crosses") {
    for (const shift of [-n, 0, n]) line(shift - 8, -8, shift + n + 8, n + 8);
  }
  return canvas;
}

function cross() {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 32;
  const pen = canvas.getContext("2d");
  for (const [colour, width] of [["#fff", 11], ["#8d0b52", 6]]) {
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.beginPath();
    pen.moveTo(6, 6); pen.lineTo(26, 26);
    pen.moveTo(26, 6); pen.lineTo(6, 26);
    pen.stroke();
  }
  return new CanvasTexture(canvas);
}

function disc(text, isChosen) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 96;
  const pen = canvas.getContext("2d");
  pen.fillStyle = isChosen ? "#7a3d00" : "#ffffff";
  pen.strokeStyle = "#16202b";
  pen.lineWidth = isChosen ? 10 : 5;
  pen.beginPath();
  pen.arc(48, 48, 40, 0, 7);
  pen.fill();
  pen.stroke();
  pen.fillStyle = isChosen ? "#ffffff" : "#16202b";
  pen.font = `bold ${text.length > 2 ? 34 : 44}px sans-serif`;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText(text, 48, 51);
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

export class PartView extends OrbitView {
  // `pick` is called with the number of a face that a person clicks.
  constructor(canvas, mesh, pick) {
    const points = mesh.vertices;
    const low = new Vector3(Infinity, Infinity, Infinity);
    const high = low.clone().negate();
    for (let i = 0; i < points.length; i += 3) {
      const one = new Vector3(points[i], points[i + 1], points[i + 2]);
      low.min(one);
      high.max(one);
    }
    const size = high.distanceTo(low);
    const turn = { azimuth: -0.75, elevation: 0.55, distance: 1.9 * size };
    super(canvas, { target: [0, 0, 0], turn, nearest: 0.6 * size, farthest: 6 * size, lowest: -1.5 });
    this.size = size;
    this.centre = low.clone().add(high).multiplyScalar(0.5);
    this.states = new Map();
    this.chosenFaces = new Set();
    this.balloons = [];
    this.body = new Group();
    this.body.matrixAutoUpdate = false;
    this.scene.add(this.body);
    this.materials = Object.keys(PATTERNS).map((state) => {
      const texture = new CanvasTexture(tile(state));
      texture.wrapS = texture.wrapT = RepeatWrapping;
      texture.colorSpace = SRGBColorSpace;
      texture.anisotropy = 4;
      return new MeshLambertMaterial({ map: texture, side: DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
    });
    this.index = Object.fromEntries(Object.keys(PATTERNS).map((state, k) => [state, k]));
    this.build(mesh);
    this.grid = new GridHelper(2.4 * size, 12, 0x8896a4, 0x8896a4);
    this.grid.rotateX(Math.PI / 2);
    this.grid.material.transparent = true;
    this.grid.material.opacity = 0.35;
    this.scene.add(this.grid);
    this.points = null;
    this.notes = new Group();
    this.body.add(this.notes);
    this.rest(null);
    this.wait(pick);
  }

  build({ vertices, triangles, face_of_triangle: faceOf }) {
    const order = faceOf.map((_, k) => k).sort((a, b) => faceOf[a] - faceOf[b]);
    const at = (k) => new Vector3(vertices[3 * k], vertices[3 * k + 1], vertices[3 * k + 2]);
    const position = new Float32Array(9 * order.length);
    const uv = new Float32Array(6 * order.length);
    const scale = TILES / this.size;
    this.spans = []; // [face, first vertex, how many]
    this.faceAt = order.map((k) => faceOf[k]);
    order.forEach((k, row) => {
      const corners = [0, 1, 2].map((c) => at(triangles[3 * k + c]));
      const normal = corners[1].clone().sub(corners[0]).cross(corners[2].clone().sub(corners[0]));
      const sizes = [Math.abs(normal.x), Math.abs(normal.y), Math.abs(normal.z)];
      const axis = sizes.indexOf(Math.max(...sizes));
      corners.forEach((p, c) => {
        position.set([p.x, p.y, p.z], 9 * row + 3 * c);
        const flat = [p.x, p.y, p.z].filter((_, i) => i !== axis);
        uv.set([flat[0] * scale, flat[1] * scale], 6 * row + 2 * c);
      });
      const face = faceOf[k];
      const last = this.spans.at(-1);
      if (last && last[0] === face) last[2] += 3;
      else this.spans.push([face, 3 * row, 3]);
    });
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(position, 3));
    geometry.setAttribute("uv", new BufferAttribute(uv, 2));
    geometry.computeVertexNormals();
    this.mesh = new Mesh(geometry, this.materials);
    this.body.add(this.mesh);
    const faceAtEdge = new Map();
    const lines = [];
    faceOf.forEach((face, k) => {
      for (const c of [0, 1, 2]) {
        const a = triangles[3 * k + c];
        const b = triangles[3 * k + (c + 1) % 3];
        const key = a < b ? `${a},${b}` : `${b},${a}`;
        const other = faceAtEdge.get(key);
        if (other === undefined) faceAtEdge.set(key, face);
        else if (other !== face) lines.push(...at(a).toArray(), ...at(b).toArray());
      }
    });
    const edges = new BufferGeometry();
    edges.setAttribute("position", new BufferAttribute(new Float32Array(lines), 3));
    this.body.add(new LineSegments(edges, new LineBasicMaterial({ color: 0x1d2935 })));
    this.paint();
  }

  // Shows the part as it rests in a stable pose; `R` has rows, null leaves it as in the CAD file.
  rest(R) {
    const turn = new Matrix4();
    if (R) turn.setFromMatrix3(new Matrix3().set(...R.flat()));
    const position = this.mesh.geometry.getAttribute("position");
    const one = new Vector3();
    const low = new Vector3(Infinity, Infinity, Infinity);
    const high = low.clone().negate();
    for (let i = 0; i < position.count; i += 1) {
      one.fromBufferAttribute(position, i).applyMatrix4(turn);
      low.min(one);
      high.max(one);
    }
    const middle = low.clone().add(high).multiplyScalar(0.5);
    const shift = new Matrix4().makeTranslation(-middle.x, -middle.y, -low.z);
    this.body.matrix.copy(shift.multiply(turn));
    this.body.matrixWorldNeedsUpdate = true;
    this.target.set(0, 0, (high.z - low.z) / 2);
    this.draw();
  }

  // Gives faces their states (Map of face and state), null for plain ones.
  show(states) {
    this.states = states || new Map();
    this.paint();
  }

  choose(faces) {
    this.chosenFaces = new Set(faces);
    this.paint();
  }

  paint() {
    const geometry = this.mesh.geometry;
    geometry.clearGroups();
    let last = null;
    for (const [face, start, count] of this.spans) {
      const state = this.chosenFaces.has(face) ? "chosen" : this.states.get(face) || "plain";
      if (last && last.state === state) last.count += count;
      else {
        if (last) geometry.addGroup(last.start, last.count, this.index[last.state]);
        last = { state, start, count };
      }
    }
    if (last) geometry.addGroup(last.start, last.count, this.index[last.state]);
    this.draw();
  }

  // Marks points that no view shows by crosses.
  mark(points) {
    this.drop(this.points);
    this.points = null;
    if (points.length) {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(new Float32Array(points.flat()), 3));
      const material = new PointsMaterial({
        size: 11, sizeAttenuation: false, map: cross(), alphaTest: 0.4, transparent: true,
        polygonOffset: true, polygonOffsetFactor: -4,
      });
      this.points = new Points(geometry, material);
      this.body.add(this.points);
    }
    this.draw();
  }

  // Numbers characteristics: [{balloon, p, axis}]; the chosen one is filled.
  number(list, chosen) {
    for (const one of [...this.notes.children]) this.drop(one);
    const few = list.length > BALLOON_MAX ? list.filter((one) => one.balloon === chosen) : list;
    const lines = [];
    const stacks = new Map(); // how many balloons stand at a place already
    for (const { balloon, p, axis } of few) {
      const from = new Vector3(...p);
      const out = from.clone().sub(this.centre);
      const along = new Vector3(...axis);
      if (out.dot(along) < 0) along.negate();
      out.normalize().addScaledVector(along, 0.8).normalize();
      const place = p.map((v) => Math.round(40 * v / this.size)).join();
      const level = stacks.get(place) || 0;
      stacks.set(place, level + 1);
      const to = from.clone().addScaledVector(out, (0.14 + 0.09 * level) * this.size);
      const isChosen = balloon === chosen;
      const material = new SpriteMaterial({ map: disc(String(balloon), isChosen), depthTest: false, sizeAttenuation: false });
      const sprite = new Sprite(material);
      sprite.scale.setScalar(isChosen ? 0.085 : 0.06);
      sprite.position.copy(to);
      sprite.renderOrder = isChosen ? 3 : 2;
      this.notes.add(sprite);
      lines.push(...from.toArray(), ...to.toArray());
    }
    const leaders = new BufferGeometry();
    leaders.setAttribute("position", new BufferAttribute(new Float32Array(lines), 3));
    this.notes.add(new LineSegments(leaders, new LineBasicMaterial({ color: 0x7a3d00, depthTest: false, transparent: true })));
    this.draw();
  }

  wait(pick) {
    let down = null;
    this.canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
    this.canvas.addEventListener("click", (event) => {
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 5) return;
      const box = this.canvas.getBoundingClientRect();
      const at = new Vector2(
        2 * (event.clientX - box.left) / box.width - 1, 1 - 2 * (event.clientY - box.top) / box.height,
      );
      const ray = new Raycaster();
      ray.setFromCamera(at, this.camera);
      const [hit] = ray.intersectObject(this.mesh);
      if (hit) pick(this.faceAt[hit.faceIndex]);
    });
  }
}
