"use strict";
/* Draws the robot in software, so that it needs no graphics card. Each pixel keeps the triangle
   that is nearest to the camera (a depth buffer). */

/* Numbers that faultgen has packed: 4 bytes each, as base64. */
function unpacked(told) {
  const bytes = Uint8Array.from(atob(told.bdata), c => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

/* A colour between two others. */
function mixed(from, to, share) {
  let colour = 0xff000000;
  for (const bits of [0, 8, 16]) {
    const a = from >>> bits & 255, b = to >>> bits & 255;
    colour |= Math.round(a + share * (b - a)) << bits;
  }
  return colour >>> 0;
}

class RobotPicture {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.camera = {...scene.camera};
    this.floor = scene.floor;  /* its height and the distance between the lines of its grid [m] */
    this.axes = scene.axes;
    this.shapes = scene.shapes.map(one => ({...one, corners: unpacked(one.corners)}));
    const most = Math.max(1, ...this.shapes.map(one => one.corners.length / 3));
    this.seen = new Float32Array(3 * most);
    this.places = scene.places;
    this.colours = scene.colours;
    this.shares = {};  /* severity of each axis from 0 to 1; links without one keep their colour */
    this.marked = [];  /* axes that get a mark with their number */
    this.aside = [[8, -6]];  /* places of the numbers beside the joints [% of the width] */
    this.turnable();
  }

  /* poses: from `Scene.poses` */
  show(poses) {
    this.poses = {...poses, bodies: unpacked(poses.bodies)};
  }

  turnable() {
    const {canvas} = this;
    let last = null;
    canvas.addEventListener("pointerdown", event => {
      last = event;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", event => {
      if (!last) return;
      this.turn(-0.5 * (event.clientX - last.clientX),
                event.pointerType === "mouse" ? -0.4 * (event.clientY - last.clientY) : 0);
      last = event;
    });
    for (const end of ["pointerup", "pointercancel"])
      canvas.addEventListener(end, () => { last = null; });
    const steps = {ArrowLeft: [-8, 0], ArrowRight: [8, 0], ArrowUp: [0, -5], ArrowDown: [0, 5]};
    canvas.addEventListener("keydown", event => {
      if (!steps[event.key]) return;
      event.preventDefault();
      this.turn(...steps[event.key]);
    });
  }

  turn(azimuth, elevation) {
    this.camera.azimuth += azimuth;
    this.camera.elevation = Math.min(5, Math.max(-85, this.camera.elevation + elevation));
    if (this.time !== undefined) this.draw(this.time);
  }

  /* Places of all bodies at a time [s], between the two nearest poses. */
  at(time) {
    const {count, period, bodies} = this.poses, size = bodies.length / count;
    const place = Math.min(Math.max(time / period, 0), count - 1);
    const first = Math.floor(place), share = place - first;
    const second = Math.min(first + 1, count - 1);
    const found = new Float32Array(size);
    for (let k = 0; k < size; k++)
      found[k] = (1 - share) * bodies[first * size + k] + share * bodies[second * size + k];
    return found;
  }

  draw(time) {
    this.time = time;
    const {canvas} = this;
    const size = Math.max(64, Math.min(640, Math.round(canvas.clientWidth * devicePixelRatio)));
    if (canvas.width !== size || !this.image) {
      canvas.width = canvas.height = size;
      this.image = this.context.createImageData(size, size);
      this.pixels = new Uint32Array(this.image.data.buffer);
      this.depth = new Float32Array(size * size);
    }
    const view = this.view(size);
    this.background(view, size);
    const bodies = this.at(time);
    if (view.eye[2] > this.floor.height)
      for (const shape of this.shapes) this.shadow(shape, bodies, view, size);
    for (const shape of this.shapes) this.fill(shape, bodies, view, size);
    this.context.putImageData(this.image, 0, 0);
    this.marked.forEach((axis, k) => this.mark(axis, this.aside[k % this.aside.length], bodies,
                                               view, size));
  }

  /* The number of an axis, in a disc beside its joint. */
  mark(axis, aside, bodies, {axes, eye, scale}, size) {
    const {body, at} = this.places[axis - 1], k = 12 * body;
    const point = [0, 1, 2].map(row => bodies[k + row] - eye[row] + [0, 1, 2].reduce(
      (sum, column) => sum + bodies[k + 3 + 3 * row + column] * at[column], 0));
    const [x, y, z] = axes.map(one => one[0] * point[0] + one[1] * point[1] + one[2] * point[2]);
    const joint = [size / 2 - scale * x / z, size / 2 + scale * y / z];
    const [column, row] = joint.map((one, n) => one + aside[n] * size / 100);
    const {context} = this, radius = 0.03 * size;
    context.lineWidth = radius / 4;
    context.strokeStyle = "#1f2328";
    context.beginPath();
    context.moveTo(...joint);
    context.lineTo(column, row);
    context.stroke();
    context.beginPath();
    context.arc(column, row, radius, 0, 2 * Math.PI);
    context.fillStyle = "#fff";
    context.fill();
    context.stroke();
    context.fillStyle = "#1f2328";
    context.font = `600 ${1.3 * radius}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(axis, column, row + 0.08 * radius);
  }

  colourOf({body, colour}) {
    const share = this.shares[this.axes[body]], [none, most] = this.colours;
    return share === undefined ? colour : none.map((one, k) => one + share * (most[k] - one));
  }

  /* Axes of the camera (right, up, towards the viewer), its place, and pixels for a length of 1 at
     a distance of 1. */
  view(size) {
    const {azimuth, elevation, lookat, distance, angle} = this.camera;
    const a = azimuth * Math.PI / 180, e = elevation * Math.PI / 180;
    const right = [Math.sin(a), -Math.cos(a), 0];
    const back = [-Math.cos(e) * Math.cos(a), -Math.cos(e) * Math.sin(a), -Math.sin(e)];
    const up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2],
                back[0] * right[1] - back[1] * right[0]];
    const axes = [right, up, back];
    const eye = lookat.map((value, k) => value + distance * back[k]);
    const lamp = [0.34, -0.42, 0.84];
    const light = axes.map(axis => axis[0] * lamp[0] + axis[1] * lamp[1] + axis[2] * lamp[2]);
    return {axes, eye, light, scale: size / 2 / Math.tan(angle * Math.PI / 360)};
  }

  background({axes, eye, scale}, size) {
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const [sky, floor, line, shadow] = dark  /* ABGR */
      ? [0xff26221d, 0xff38332e, 0xff575047, 0xff262220]
      : [0xfffaf6f3, 0xffe0dbd6, 0xffc8c1bb, 0xffbbb5b0];
    this.shade = shadow;
    this.depth.fill(Infinity);
    const {height, grid} = this.floor, high = eye[2] - height, [right, up, back] = axes;
    for (let row = 0; row < size; row++) {
      const rise = (size / 2 - row - 0.5) / scale, fall = rise * up[2] - back[2];
      const at = row * size;
      this.pixels.fill(fall < 0 ? floor : sky, at, at + size);
      const ahead = -high / fall, pixel = ahead / scale * Math.hypot(1, ahead / high);
      /* lines fade with the distance */
      const seen = Math.min(1, 1.3 - ahead / (12 * grid + this.camera.distance));
      if (fall >= 0 || high <= 0 || seen <= 0) continue;
      const colour = mixed(floor, line, seen);
      /* where the ray of each pixel meets the floor, in units of the grid */
      const half = Math.max(0.006, pixel / grid / 2), step = ahead / scale / grid;
      const [x0, y0] = [0, 1].map(k => (eye[k] + ahead * (rise * up[k] - back[k]
        + (0.5 - size / 2) / scale * right[k])) / grid);
      for (let column = 0; column < size; column++) {
        const x = x0 + column * step * right[0], y = y0 + column * step * right[1];
        if (Math.abs(x - Math.round(x)) < half || Math.abs(y - Math.round(y)) < half)
          this.pixels[at + column] = colour;
      }
    }
  }

  /* Moves the corners of a shape from the frame of its body to that of the camera. */
  see({body, corners}, bodies, {axes, eye}) {
    const at = 12 * body, seen = this.seen, m = [];
    for (const axis of axes) {
      for (let k = 0; k < 3; k++)
        m.push(axis[0] * bodies[at + 3 + k] + axis[1] * bodies[at + 6 + k]
               + axis[2] * bodies[at + 9 + k]);
      m.push(axis[0] * (bodies[at] - eye[0]) + axis[1] * (bodies[at + 1] - eye[1])
             + axis[2] * (bodies[at + 2] - eye[2]));
    }
    for (let k = 0; k < corners.length; k += 3) {
      const x = corners[k], y = corners[k + 1], z = corners[k + 2];
      seen[k] = m[0] * x + m[1] * y + m[2] * z + m[3];
      seen[k + 1] = m[4] * x + m[5] * y + m[6] * z + m[7];
      seen[k + 2] = m[8] * x + m[9] * y + m[10] * z + m[11];
    }
  }

  /* Darkens the floor where a shape keeps the light away. */
  shadow(shape, bodies, view, size) {
    this.see(shape, bodies, view);
    const {seen} = this, {axes, eye, light, scale} = view, half = size / 2;
    const upward = axes.map(axis => axis[2]), high = eye[2] - this.floor.height;
    const fall = upward[0] * light[0] + upward[1] * light[1] + upward[2] * light[2];
    for (let k = 0; k < shape.corners.length; k += 3) {
      const above = (upward[0] * seen[k] + upward[1] * seen[k + 1] + upward[2] * seen[k + 2]
        + high) / fall;
      for (let row = 0; row < 3; row++) seen[k + row] -= above * light[row];
    }
    for (let k = 0; k < shape.corners.length; k += 9) {
      const az = seen[k + 2], bz = seen[k + 5], cz = seen[k + 8];
      if (az > -0.01 || bz > -0.01 || cz > -0.01) continue;  /* behind the camera */
      /* at the distance of the floor, behind all shapes */
      this.triangle(half - scale * seen[k] / az, half + scale * seen[k + 1] / az, 0,
                    half - scale * seen[k + 3] / bz, half + scale * seen[k + 4] / bz, 0,
                    half - scale * seen[k + 6] / cz, half + scale * seen[k + 7] / cz, 0,
                    this.shade, size);
    }
  }

  fill(shape, bodies, view, size) {
    this.see(shape, bodies, view);
    const {corners} = shape, {seen} = this, {light, scale} = view, half = size / 2;
    const [red, green, blue] = this.colourOf(shape);
    for (let k = 0; k < corners.length; k += 9) {
      const az = seen[k + 2], bz = seen[k + 5], cz = seen[k + 8];
      if (az > -0.01 || bz > -0.01 || cz > -0.01) continue;  /* behind the camera */
      const ux = seen[k + 3] - seen[k], uy = seen[k + 4] - seen[k + 1], uz = bz - az;
      const vx = seen[k + 6] - seen[k], vy = seen[k + 7] - seen[k + 1], vz = cz - az;
      let nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      if (nx * seen[k] + ny * seen[k + 1] + nz * az >= 0) continue;  /* seen from inside */
      const length = Math.hypot(nx, ny, nz) || 1;
      nx /= length; ny /= length; nz /= length;
      const lit = Math.max(0, nx * light[0] + ny * light[1] + nz * light[2]);
      const shade = 255 * (0.45 + 0.35 * lit + 0.25 * Math.abs(nz));
      const colour32 = 0xff000000 | Math.min(255, shade * blue) << 16
        | Math.min(255, shade * green) << 8 | Math.min(255, shade * red);
      this.triangle(half - scale * seen[k] / az, half + scale * seen[k + 1] / az, -1 / az,
                    half - scale * seen[k + 3] / bz, half + scale * seen[k + 4] / bz, -1 / bz,
                    half - scale * seen[k + 6] / cz, half + scale * seen[k + 7] / cz, -1 / cz,
                    colour32, size);
    }
  }

  /* Corners in pixels, with the inverse of their distances, which changes evenly between them. */
  triangle(ax, ay, ai, bx, by, bi, cx, cy, ci, colour, size) {
    const area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay);
    if (Math.abs(area) < 1e-9) return;
    const left = Math.max(0, Math.floor(Math.min(ax, bx, cx)));
    const right = Math.min(size - 1, Math.ceil(Math.max(ax, bx, cx)));
    const top = Math.max(0, Math.floor(Math.min(ay, by, cy)));
    const bottom = Math.min(size - 1, Math.ceil(Math.max(ay, by, cy)));
    const {pixels, depth} = this;
    for (let row = top; row <= bottom; row++) {
      const y = row + 0.5;
      for (let column = left; column <= right; column++) {
        const x = column + 0.5;
        const first = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area;
        const second = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area;
        const third = 1 - first - second;
        if (first < 0 || second < 0 || third < 0) continue;
        const distance = 1 / (first * ai + second * bi + third * ci);
        const place = row * size + column;
        if (distance <= depth[place]) { depth[place] = distance; pixels[place] = colour; }
      }
    }
  }
}
