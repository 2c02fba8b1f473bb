// The 3D view: map, fence, goals, key points, trajectory, trail and robot. Odom ENU, metres, z up.
// It draws when something has changed, never on a timer of its own.
import { MapControls, THREE } from "nicegui-scene";

const COLOURS = {
  light: { back: 0xf1f4f8, grid: 0xc6ced8, cell: 0x39424e, fence: 0x0f7a3d, out: 0xb42318, robot: 0x101820,
           land: 0xc2560a, air: 0x1452cc, path: 0x0c8577, goal: 0x7a1fa2, pick: 0xd0021b },
  dark: { back: 0x0d1117, grid: 0x2a333f, cell: 0xc4ccd6, fence: 0x4ade80, out: 0xff7b72, robot: 0xffffff,
          land: 0xffa94d, air: 0x79b8ff, path: 0x2dd4bf, goal: 0xd8a4ff, pick: 0xffdf5d },
};
const CELL_M = 0.1;
const SHARE = 0.12; // of the time may go into drawing where a processor must do it
const FASTEST_MS = 66;
const SLOWEST_MS = 800;

export class Scene {
  constructor(holder, onPick) {
    this.holder = holder;
    this.onPick = onPick;
    this.renderer = new THREE.WebGLRenderer({ antialias: !software(), powerPreference: "low-power" });
    this.every_ms = FASTEST_MS;
    this.drawn = { count: 0, at_ms: 0 };
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 1.5));
    holder.appendChild(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(50, 1, 0.1, 300);
    this.camera.up.set(0, 0, 1);
    this.controls = new MapControls(this.camera, this.renderer.domElement);
    this.controls.enableDamping = false;
    this.controls.maxPolarAngle = 1.45;
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => (this.moved = true));
    this.scene.add(new THREE.AmbientLight(0xffffff, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(4, -6, 12);
    this.scene.add(sun);
    this.layers = {};
    this.floor_m = 0;
    this.follow = true;
    this.moved = false;
    this.theme("light");
    this.resizer = new ResizeObserver(() => this.resize());
    this.resizer.observe(holder);
    this.listenForPicks();
    this.resize();
  }

  theme(name) {
    this.colours = COLOURS[name];
    this.paper = name === "dark" ? "#0d1117" : "#ffffff";
    this.scene.background = new THREE.Color(this.colours.back);
    if (this.facts) this.setFacts(this.facts);
    if (this.map) this.setMap(this.map.cells, this.map.trail);
    if (this.state) this.setState(this.state);
    this.draw();
  }

  resize() {
    const { clientWidth: w, clientHeight: h } = this.holder;
    if (!w || !h) return;
    this.renderer.setSize(w, h);
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.draw(0); // at once: it was cleared
  }

  draw(wait_ms = Math.max(0, this.drawn.at_ms + this.every_ms - performance.now())) {
    if (this.gone || (this.pending && wait_ms > 0)) return;
    clearTimeout(this.pending);
    this.pending = setTimeout(() => requestAnimationFrame(() => this.drawNow()), wait_ms);
  }

  // Figures go before pictures: where drawing is slow, it is done less often.
  drawNow() {
    this.pending = null;
    if (this.gone) return;
    if (this.stale) this.update();
    const began = performance.now();
    this.renderer.render(this.scene, this.camera);
    if (this.drawn.count++ % 10 === 0) this.learn(began);
    this.drawn.at_ms = performance.now();
  }

  // How long drawing takes, all of it: the fence passes when the last pixel is there.
  learn(began_ms) {
    const gl = this.renderer.getContext();
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      if (this.gone) return;
      if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) return void setTimeout(look, 8);
      gl.deleteSync(fence);
      const took_ms = performance.now() - began_ms;
      this.every_ms = Math.min(SLOWEST_MS, Math.max(FASTEST_MS, took_ms / SHARE));
    };
    setTimeout(look, 4);
  }

  dispose() {
    this.gone = true;
    clearTimeout(this.pending);
    this.resizer.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
  }

  layer(name, ...things) {
    const old = this.layers[name];
    if (old) {
      this.scene.remove(old);
      old.traverse((o) => {
        o.geometry?.dispose();
        o.material?.map?.dispose();
        o.material?.dispose();
      });
    }
    const group = new THREE.Group();
    for (const thing of things) if (thing) group.add(thing);
    this.layers[name] = group;
    this.scene.add(group);
    if (name === "facts" || name === "map" || name === "pick") this.draw();
  }

  // ---- what holds for the whole flight
  setFacts(facts) {
    this.facts = facts;
    this.floor_m = facts.floor_z_m || 0;
    const xs = [facts.home_m[0]], ys = [facts.home_m[1]];
    const things = [];
    for (const fence of facts.fences) {
      const ring = fence.radius_m ? circle(fence.outline_m[0], fence.radius_m) : fence.outline_m;
      for (const [x, y] of ring) xs.push(x), ys.push(y);
      const places = [...ring, ring[0]].map(([x, y]) => [x, y, this.floor_m + 0.02]);
      const colour = fence.keep_in ? this.colours.fence : this.colours.out;
      things.push(ribbon(places, 0.09, colour));
      // posts: a fence is told from a line on the floor without its colour
      for (const [x, y] of ring) things.push(post(x, y, this.floor_m, fence.keep_in ? 0.5 : 1.0, colour));
    }
    const low = [Math.min(...xs) - 2, Math.min(...ys) - 2], high = [Math.max(...xs) + 2, Math.max(...ys) + 2];
    this.middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    this.span = Math.max(high[0] - low[0], high[1] - low[1], 8);
    const size = 2 * Math.ceil(this.span / 2 + 2);
    const grid = new THREE.GridHelper(size, size, this.colours.grid, this.colours.grid);
    grid.rotation.x = Math.PI / 2;
    grid.position.set(Math.round(this.middle[0]), Math.round(this.middle[1]), this.floor_m);
    this.layer("facts", grid, ...things);
    if (!this.moved) this.look("over");
  }

  look(how) {
    const at = how === "robot" && this.state?.pose ? this.state.pose.position_m : [...this.middle, this.floor_m];
    const away = how === "robot" ? 5 : this.span / Math.min(1, this.camera.aspect);
    const lift = how === "top" ? 1 : 0.72;
    const back = Math.sqrt(1 - lift * lift) + 0.001;
    this.follow = how === "robot";
    this.controls.target.set(...at);
    this.camera.position.set(at[0], at[1] - away * back, at[2] + away * lift);
    this.controls.update();
    this.draw();
  }

  // ---- the map and the way travelled
  setMap(cells, trail) {
    this.map = { cells, trail };
    const count = cells.length / 2;
    const box = new THREE.BoxGeometry(CELL_M, CELL_M, 0.35);
    const boxes = new THREE.InstancedMesh(box, new THREE.MeshLambertMaterial({ color: this.colours.cell }), count);
    const place = new THREE.Matrix4();
    for (let i = 0; i < count; i++) {
      boxes.setMatrixAt(i, place.makeTranslation(cells[2 * i], cells[2 * i + 1], this.floor_m + 0.175));
    }
    this.layer("map", boxes);
    const parts = [];
    for (let i = 0, run = []; i < trail.length; i += 4) {
      run.push([trail[i], trail[i + 1], trail[i + 2]]);
      const next = i + 7 < trail.length ? trail[i + 7] : null;
      if (next === trail[i + 3]) continue;
      parts.push(ribbon(run, 0.1, trail[i + 3] ? this.colours.air : this.colours.land));
      run = [run[run.length - 1]];
    }
    this.layer("trail", ...parts);
  }

  // ---- what changes
  setState(state) {
    this.state = state;
    this.stale = true;
    this.draw();
  }

  update() {
    this.stale = false;
    const state = this.state;
    const c = this.colours, plan = state.plan;
    const points = (plan?.network || []).map(([x, y, z, air]) => marker(x, y, z, air, air ? c.air : c.land));
    const path = plan?.path_m?.length > 1 ? ribbon(plan.path_m.map(([x, y, z]) => [x, y, z + 0.05]), 0.14, c.path) : null;
    this.layer("plan", path, ...points);
    const goals = [];
    state.steps.forEach((step, i) => {
      if (step.place_m && step.state !== "done") goals.push(...this.flag(step, i + (state.steps_first ?? 0)));
    });
    this.layer("goals", ...goals);
    this.layer("robot", state.pose ? this.robot(state) : null);
    if (this.follow && state.pose) {
      const to = new THREE.Vector3(...state.pose.position_m);
      const shift = to.clone().sub(this.controls.target);
      this.controls.target.copy(to);
      this.camera.position.add(shift);
      this.camera.updateMatrixWorld();
    }
  }

  flag(step, index) {
    const [x, y, z] = step.place_m, now = step.state === "now";
    const top = step.air ? z : this.floor_m + 0.9;
    const ring = new THREE.Mesh(new THREE.RingGeometry(0.22, now ? 0.34 : 0.28, 28),
      new THREE.MeshBasicMaterial({ color: this.colours.goal, side: THREE.DoubleSide }));
    ring.position.set(x, y, (step.air ? z : this.floor_m) + 0.03);
    const stem = new THREE.Mesh(new THREE.CylinderGeometry(0.015, 0.015, top - this.floor_m, 6),
      new THREE.MeshBasicMaterial({ color: this.colours.goal }));
    stem.rotation.x = Math.PI / 2;
    stem.position.set(x, y, (top + this.floor_m) / 2);
    const word = label(`${index + 1}${step.air ? " ↑" : ""}`, this.colours.goal, now ? 0.75 : 0.55, this.paper);
    word.position.set(x, y, top + 0.35);
    return [ring, stem, word];
  }

  robot(state) {
    const [x, y, z] = state.pose.position_m, r = this.facts?.radius_m || 0.3;
    const group = new THREE.Group();
    const colour = state.mode === "AIR" ? this.colours.air : this.colours.robot;
    const body = new THREE.Mesh(new THREE.CylinderGeometry(r, r, 0.14, 28),
      new THREE.MeshLambertMaterial({ color: colour, transparent: true, opacity: 0.75 }));
    body.rotation.x = Math.PI / 2;
    const nose = new THREE.Mesh(new THREE.ConeGeometry(0.16, 0.42, 12), new THREE.MeshLambertMaterial({ color: colour }));
    nose.rotation.z = -Math.PI / 2;
    nose.position.set(r + 0.1, 0, 0.05);
    group.add(body, nose);
    group.position.set(x, y, z);
    group.rotation.z = state.pose.yaw_rad;
    const whole = new THREE.Group();
    whole.add(group);
    if (z - this.floor_m > 0.4) {
      whole.add(ribbon([[x, y, this.floor_m], [x, y, z]], 0.03, colour));
      const shade = new THREE.Mesh(new THREE.RingGeometry(r * 0.8, r, 28),
        new THREE.MeshBasicMaterial({ color: colour, side: THREE.DoubleSide }));
      shade.position.set(x, y, this.floor_m + 0.02);
      whole.add(shade);
    }
    return whole;
  }

  // ---- a place is picked with a click that did not drag
  listenForPicks() {
    const canvas = this.renderer.domElement;
    let down = null;
    canvas.addEventListener("pointerdown", (e) => (down = [e.clientX, e.clientY]));
    canvas.addEventListener("pointerup", (e) => {
      if (!down || Math.hypot(e.clientX - down[0], e.clientY - down[1]) > 8) return;
      const place = this.placeAt(e.clientX, e.clientY);
      if (place) this.onPick(place);
    });
  }

  placeAt(clientX, clientY) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const at = new THREE.Vector2(((clientX - box.left) / box.width) * 2 - 1, 1 - ((clientY - box.top) / box.height) * 2);
    const ray = new THREE.Raycaster();
    ray.setFromCamera(at, this.camera);
    const hit = ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), -this.floor_m), new THREE.Vector3());
    return hit ? [hit.x, hit.y] : null;
  }

  // Where a place on the floor is drawn, in pixels of the page.
  pixelOf(x, y) {
    const box = this.renderer.domElement.getBoundingClientRect();
    this.camera.updateMatrixWorld();
    const v = new THREE.Vector3(x, y, this.floor_m).project(this.camera);
    return [box.left + ((v.x + 1) / 2) * box.width, box.top + ((1 - v.y) / 2) * box.height];
  }

  setPick(place) {
    if (!place) return this.layer("pick");
    const [x, y] = place;
    const word = label("go here?", this.colours.pick, 0.7, this.paper);
    word.position.set(x, y, this.floor_m + 0.7);
    this.layer("pick", ribbon([[x - 0.3, y - 0.3, this.floor_m + 0.05], [x + 0.3, y + 0.3, this.floor_m + 0.05]], 0.09, this.colours.pick),
      ribbon([[x - 0.3, y + 0.3, this.floor_m + 0.05], [x + 0.3, y - 0.3, this.floor_m + 0.05]], 0.09, this.colours.pick), word);
  }
}

function software() {
  const gl = document.createElement("canvas").getContext("webgl");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

function circle([cx, cy], r) {
  return Array.from({ length: 48 }, (_, i) => [cx + r * Math.cos((i * Math.PI) / 24), cy + r * Math.sin((i * Math.PI) / 24)]);
}

// A flat band along places: lines of WebGL are one pixel wide, which nobody sees in the sun.
function ribbon(places, width, colour) {
  if (places.length < 2) return null;
  const at = [], index = [];
  for (let i = 0; i + 1 < places.length; i++) {
    const [a, b] = [places[i], places[i + 1]];
    const dx = b[0] - a[0], dy = b[1] - a[1], flat = Math.hypot(dx, dy);
    const [nx, ny] = flat > 1e-6 ? [(-dy / flat) * width / 2, (dx / flat) * width / 2] : [width / 2, 0];
    const n = at.length / 3;
    at.push(a[0] + nx, a[1] + ny, a[2], a[0] - nx, a[1] - ny, a[2], b[0] + nx, b[1] + ny, b[2], b[0] - nx, b[1] - ny, b[2]);
    index.push(n, n + 1, n + 2, n + 1, n + 3, n + 2);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(at, 3));
  geometry.setIndex(index);
  return new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: colour, side: THREE.DoubleSide }));
}

function post(x, y, floor, height, colour) {
  const mesh = new THREE.Mesh(new THREE.BoxGeometry(0.08, 0.08, height), new THREE.MeshBasicMaterial({ color: colour }));
  mesh.position.set(x, y, floor + height / 2);
  return mesh;
}

// On land a ball, in the air a pyramid: told apart without the colour.
function marker(x, y, z, air, colour) {
  const shape = air ? new THREE.ConeGeometry(0.14, 0.26, 4) : new THREE.SphereGeometry(0.1, 14, 10);
  const mesh = new THREE.Mesh(shape, new THREE.MeshLambertMaterial({ color: colour }));
  if (air) mesh.rotation.x = Math.PI / 2;
  mesh.position.set(x, y, z);
  return mesh;
}

function label(text, colour, size, back) {
  const canvas = document.createElement("canvas");
  canvas.width = 256;
  canvas.height = 96;
  const pen = canvas.getContext("2d");
  pen.font = "bold 64px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 12;
  pen.strokeStyle = back;
  pen.strokeText(text, 128, 48, 250);
  pen.fillStyle = `#${colour.toString(16).padStart(6, "0")}`;
  pen.fillText(text, 128, 48, 250);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
  sprite.scale.set(size * 2.4, size * 0.9, 1);
  return sprite;
}
