"use strict";
// Animated mode shapes: stored surfaces drawn by three.js, which is unpacked when the first one comes into view.
(() => {
  const PERIOD = 1600; // ms: one period, slowed down to be visible
  const VIEW = [1.0, -1.6, 1.3]; // from the body to the eye
  const VIEWS = { reset: VIEW, below: [0, -1e-3, -1], side: [0, -1, 0] };
  const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

  // --- stored surfaces ---------------------------------------------------------------------------------------------
  async function surface(stored) { // mm, from the centre of the touch face
    const steps = await unpack.rows(stored.points, 3, 2);
    const points = Float32Array.from(steps, (step, i) => 1e3 * (stored.low[i % 3] + (step / 0xffff) * stored.span[i % 3]));
    const size = stored.wide ? 4 : 2, span = 2 ** (8 * size);
    const corners = await unpack.rows(stored.facets, stored.corners, size); // differences from the previous facet
    for (let i = stored.corners; i < corners.length; i++) corners[i] = (corners[i] + corners[i - stored.corners]) % span;
    const triangles = [];
    for (let i = 0; i < corners.length; i += stored.corners) {
      triangles.push(corners[i], corners[i + 1], corners[i + 2]);
      if (stored.corners === 4 && corners[i + 2] !== corners[i + 3]) triangles.push(corners[i], corners[i + 2], corners[i + 3]);
    }
    return { points, triangles };
  }
  const part = async (text, count) =>
    text ? Float32Array.from(await unpack.rows(text, 3, 2, true), (step) => step / 32767) : new Float32Array(count);

  // --- drawing -----------------------------------------------------------------------------------------------------
  let library = null;
  const three = () => library;
  async function load_three() {
    const code = await unpack.text(document.querySelector("#three").textContent);
    if (library) return;
    const script = document.createElement("script");
    script.textContent = code;
    document.head.append(script);
    library = globalThis.AntinodeThree;
  }

  const VERTEX = `
    attribute vec3 re; attribute vec3 im;
    uniform vec3 flip; uniform vec3 offset; uniform vec2 turn; uniform float parity; uniform float drawn; uniform float normal_peak;
    varying vec3 seen; varying float level;
    void main() {
      vec3 u = parity * flip * (re * turn.x - im * turn.y);
      level = u.z / normal_peak;
      vec4 place = modelViewMatrix * vec4(flip * position + offset + drawn * u, 1.0);
      seen = place.xyz;
      gl_Position = projectionMatrix * place;
    }`;
  const FRAGMENT = `
    varying vec3 seen; varying float level;
    void main() {
      vec3 slope = normalize(cross(dFdx(seen), dFdy(seen)));
      float light = 0.5 + 0.5 * abs(dot(slope, normalize(vec3(0.25, 0.45, 0.86))));
      float size = clamp(abs(level), 0.0, 1.0);
      vec3 end = level > 0.0 ? vec3(0.80, 0.10, 0.12) : vec3(0.07, 0.33, 0.68);
      gl_FragColor = vec4(mix(vec3(0.93), end, pow(size, 0.7)) * light, 1.0);
    }`;

  class Viewer {
    constructor(figure, data) {
      this.figure = figure;
      this.data = data;
      this.canvas = figure.querySelector("canvas");
      this.picker = figure.querySelector("select");
      this.size = figure.querySelector("input[type=range]");
      this.buttons = Object.fromEntries([...figure.querySelectorAll("button")].map((button) => [button.dataset.do, button]));
      this.surfaces = new Map();
      this.playing = !calm;
      this.visible = false;
      this.time = 0;
      this.frames = 0;
      this.number = 0;
      this.fill_picker();
      this.listen();
      new IntersectionObserver((entries) => this.seen(entries.at(-1).isIntersecting)).observe(figure);
    }

    fill_picker() {
      const groups = new Map();
      this.data.shapes.forEach((shape, number) => {
        if (!groups.has(shape.group)) {
          const group = document.createElement("optgroup");
          group.label = shape.group;
          groups.set(shape.group, group);
          this.picker.append(group);
        }
        const option = document.createElement("option");
        option.value = number;
        option.textContent = shape.name;
        groups.get(shape.group).append(option);
      });
    }

    listen() {
      this.picker.addEventListener("change", () => this.show(Number(this.picker.value)));
      this.size.addEventListener("input", () => this.later());
      this.buttons.play.addEventListener("click", () => this.play(!this.playing));
      for (const [name, view] of Object.entries(VIEWS)) this.buttons[name].addEventListener("click", () => this.look(view));
      this.buttons.save.addEventListener("click", () => this.save());
      this.buttons.film.addEventListener("click", () => this.film());
      const keys = {
        ArrowLeft: () => this.turn(-0.12, 0), ArrowRight: () => this.turn(0.12, 0), ArrowUp: () => this.turn(0, -0.12),
        ArrowDown: () => this.turn(0, 0.12), "+": () => this.closer(0.87), "=": () => this.closer(0.87), "-": () => this.closer(1.15),
        " ": () => this.play(!this.playing), 0: () => this.look(), Home: () => this.look(),
      };
      this.canvas.addEventListener("keydown", (event) => {
        const act = this.scene && !event.ctrlKey && !event.metaKey && !event.altKey && keys[event.key];
        if (act) { event.preventDefault(); act(); }
      });
      for (const kind of ["focus", "blur"]) this.canvas.addEventListener(kind, () => { if (this.orbit) this.orbit.enableZoom = kind === "focus"; });
      addEventListener("visibilitychange", () => this.later());
    }

    seen(visible) {
      this.visible = visible;
      if (visible && !this.scene && this.figure.dataset.state === "waiting") this.start();
      if (this.scene) this.later();
    }

    async start() {
      this.figure.dataset.state = "loading";
      try {
        if (!document.createElement("canvas").getContext("webgl2")) throw new Error("no WebGL");
        await load_three();
        const { WebGLRenderer, Scene, PerspectiveCamera, OrbitControls } = three();
        this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true });
        this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
        this.camera = new PerspectiveCamera(2, 1, 1, 1e4);
        this.camera.up.set(0, 0, 1);
        this.orbit = new OrbitControls(this.camera, this.canvas);
        this.orbit.enableZoom = document.activeElement === this.canvas;
        this.orbit.addEventListener("change", () => this.later());
        this.scene = new Scene();
      } catch {
        return this.still();
      }
      this.canvas.addEventListener("webglcontextlost", () => this.still());
      new ResizeObserver(() => this.fit()).observe(this.canvas.parentElement);
      this.fit();
      await this.show(this.number);
      this.play(this.playing);
    }

    still() { // no WebGL: show the still picture of the same mode
      this.scene = null;
      this.visible = false;
      this.figure.dataset.state = "still";
      this.canvas.hidden = true;
      for (const control of [...Object.values(this.buttons), this.size]) control.disabled = true;
      this.show(this.number);
    }

    async show(number) {
      this.number = number;
      this.picker.value = number;
      const shape = this.data.shapes[number];
      const about = this.figure.querySelector(".about");
      about.textContent = `${shape.about}.`;
      this.canvas.setAttribute("aria-label", `${shape.about}, animated; arrow keys rotate it, space plays and pauses`);
      if (this.figure.dataset.state === "still") return this.show_still(shape, about);
      if (!this.scene) return;
      const geometry = await this.geometry(shape);
      if (this.number !== number) return; // another shape was chosen in the meantime
      const fresh = this.body !== shape.body;
      this.body = shape.body;
      this.scene.clear();
      this.materials = shape.copies.map((copy) => this.add(shape, copy, geometry));
      if (fresh) this.look();
      this.later();
    }

    show_still(shape, about) {
      const picture = document.querySelector(`#${CSS.escape(shape.still || "none")} img`);
      const stage = this.canvas.parentElement;
      stage.querySelector("img")?.remove();
      if (picture) stage.append(Object.assign(document.createElement("img"), { src: picture.src, alt: picture.alt }));
      about.textContent += picture ? " WebGL is not available: showing a still picture." : " WebGL is not available, and the page has no still picture.";
    }

    add(shape, copy, geometry) {
      const { Mesh, ShaderMaterial, Vector2, Vector3, DoubleSide } = three();
      const stored = this.data.bodies[shape.body];
      const material = new ShaderMaterial({
        vertexShader: VERTEX, fragmentShader: FRAGMENT, side: DoubleSide,
        uniforms: {
          flip: { value: new Vector3(...copy.flip) }, parity: { value: copy.parity }, turn: { value: new Vector2(1, 0) },
          offset: { value: new Vector3(...(copy.offset ?? [0, 0, 0]).map((metres) => 1e3 * metres)) },
          drawn: { value: 1e3 * stored.reach }, normal_peak: { value: shape.normal },
        },
      });
      const mesh = new Mesh(geometry, material);
      mesh.frustumCulled = false;
      this.scene.add(mesh);
      return { material, phase: copy.phase ?? 0 };
    }

    async geometry(shape) {
      if (!this.surfaces.has(shape)) {
        const { BufferGeometry, BufferAttribute } = three();
        const { points, triangles } = await surface(this.data.bodies[shape.body]);
        const made = new BufferGeometry();
        made.setAttribute("position", new BufferAttribute(points, 3));
        made.setAttribute("re", new BufferAttribute(await part(shape.re, points.length), 3));
        made.setAttribute("im", new BufferAttribute(await part(shape.im, points.length), 3));
        made.setIndex(triangles);
        this.surfaces.set(shape, made);
      }
      return this.surfaces.get(shape);
    }

    // --- camera ------------------------------------------------------------------------------------------------------
    fit() {
      const stage = this.canvas.parentElement;
      const width = Math.max(1, stage.clientWidth), height = Math.round(Math.min(Math.max(260, 0.5 * width), 0.7 * innerHeight));
      this.renderer.setSize(width, height);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      this.later();
    }

    look(view = VIEW) {
      const shape = this.data.shapes[this.number], body = this.data.bodies[shape.body];
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      for (const { flip, offset = [0, 0, 0] } of shape.copies) {
        for (let axis = 0; axis < 3; axis++) {
          for (const end of [body.low[axis], body.low[axis] + body.span[axis]]) {
            const at = 1e3 * (flip[axis] * end + offset[axis]);
            low[axis] = Math.min(low[axis], at);
            high[axis] = Math.max(high[axis], at);
          }
        }
      }
      const middle = low.map((value, axis) => (value + high[axis]) / 2);
      const length = Math.hypot(...view), toward = view.map((value) => value / length);
      const distance = this.distance(low.map((value, axis) => (high[axis] - value) / 2), toward);
      this.orbit.target.set(...middle);
      this.camera.position.set(...toward.map((value, axis) => middle[axis] + value * distance));
      Object.assign(this.camera, { near: distance / 100, far: distance * 10 });
      this.camera.updateProjectionMatrix();
      this.orbit.update();
      this.later();
    }

    distance(half, toward) { // distance at which all eight corners of a box are visible
      const { Vector3 } = three();
      const eye = new Vector3(...toward), right = new Vector3(0, 0, 1).cross(eye).normalize(), up = eye.clone().cross(right);
      const high = Math.tan((this.camera.fov * Math.PI) / 360), wide = high * this.camera.aspect;
      let found = 0;
      for (let corner = 0; corner < 8; corner++) {
        const at = new Vector3(...half.map((value, axis) => (corner & (1 << axis) ? value : -value)));
        found = Math.max(found, at.dot(eye) + Math.max(Math.abs(at.dot(right)) / wide, Math.abs(at.dot(up)) / high));
      }
      return 1.12 * found;
    }

    save() {
      if (!this.materials) return;
      this.renderer.render(this.scene, this.camera); // the canvas is cleared once its picture is on the screen
      this.keep(this.canvas.toDataURL("image/png"), "png");
    }

    film() { // one period, encoded by the browser
      if (!this.materials || !window.MediaRecorder || !this.canvas.captureStream) return;
      const recorder = new MediaRecorder(this.canvas.captureStream(30)), parts = [];
      recorder.addEventListener("dataavailable", (event) => parts.push(event.data));
      recorder.addEventListener("stop", () => {
        const kind = recorder.mimeType.includes("mp4") ? "mp4" : "webm";
        this.keep(URL.createObjectURL(new Blob(parts, { type: recorder.mimeType })), kind);
        this.buttons.film.disabled = false;
      });
      this.buttons.film.disabled = true;
      this.play(true);
      recorder.start();
      setTimeout(() => recorder.stop(), PERIOD);
    }

    keep(href, kind) {
      const name = `${this.data.shapes[this.number].about.replace(/[^\p{L}\p{N}.]+/gu, "-")}.${kind}`;
      Object.assign(document.createElement("a"), { href, download: name }).click();
    }

    turn(around, down) {
      const { Spherical, Vector3 } = three();
      const away = new Vector3().subVectors(this.camera.position, this.orbit.target);
      const ball = new Spherical().setFromCartesianCoords(away.x, away.z, -away.y); // its axis is y, ours is z
      ball.theta += around;
      ball.phi = Math.min(Math.max(ball.phi + down, 0.05), Math.PI - 0.05);
      const next = new Vector3().setFromSpherical(ball);
      this.camera.position.set(this.orbit.target.x + next.x, this.orbit.target.y - next.z, this.orbit.target.z + next.y);
      this.orbit.update();
      this.later();
    }

    closer(factor) {
      this.camera.position.sub(this.orbit.target).multiplyScalar(factor).add(this.orbit.target);
      this.orbit.update();
      this.later();
    }

    // --- moving ------------------------------------------------------------------------------------------------------
    play(on) {
      this.playing = on;
      this.buttons.play.textContent = on ? "Pause" : "Play";
      this.buttons.play.setAttribute("aria-pressed", on);
      this.figure.dataset.state = on ? "playing" : "paused";
      this.last = null;
      this.later();
    }

    later() {
      if (this.materials && this.scene && this.visible && !document.hidden) this.waiting ||= requestAnimationFrame((now) => this.draw(now));
    }

    draw(now) {
      this.waiting = 0;
      if (!this.scene) return;
      if (this.playing) {
        this.time += this.last == null ? 0 : Math.min(now - this.last, 100);
        this.last = now;
      }
      const angle = (2 * Math.PI * this.time) / PERIOD;
      const drawn = 1e3 * this.data.bodies[this.body].reach * 10 ** ((Number(this.size.value) - 50) / 50);
      for (const { material, phase } of this.materials) {
        material.uniforms.turn.value.set(Math.cos(angle + phase), Math.sin(angle + phase));
        material.uniforms.drawn.value = drawn;
      }
      this.figure.querySelector("output").textContent = `${drawn.toPrecision(2)} mm`;
      this.renderer.render(this.scene, this.camera);
      this.canvas.dataset.frames = ++this.frames;
      if (this.playing) this.later();
    }
  }

  // --- the page's viewers ------------------------------------------------------------------------------------------
  const read = (id) => JSON.parse(document.getElementById(id)?.textContent || "{}");
  const plate = document.querySelector('[data-viewer="plate"]');
  if (plate) new Viewer(plate, read("shapes-data"));
  const waves = document.querySelector('[data-viewer="waves"]');
  let shown = null;
  if (waves) {
    addEventListener("antinode:wave", (event) => {
      waves.parentElement.hidden = false;
      shown ??= new Viewer(waves, read("bands-data"));
      shown.show(event.detail);
    });
  }
})();
