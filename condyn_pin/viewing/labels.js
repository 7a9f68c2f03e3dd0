// Words are drawn over the picture, as many pixels each as the screen has: they stay sharp while the
// picture itself has fewer, in a motion. One that would cover another moves up or down to the nearest
// place that is free, from picture to picture as little as it can, and a thin line leads back.

{
  let overlay = document.getElementById("labels");
  let shifts = new Map();  // of labels, in lines upwards

  // Pictures of words come when they are decoded, after the page.
  function words() {
    let found = [];
    viewer.scene.traverse(object => { if (object.isSprite) found.push(object); });
    return found;
  }

  // Where a label is on the screen [px], if it is to be seen: its middle, and its size.
  function box(sprite, pixels) {
    let at = sprite.getWorldPosition(new MeshCat.THREE.Vector3());
    let size = sprite.getWorldScale(new MeshCat.THREE.Vector3());
    let depth = at.clone().applyMatrix4(viewer.camera.matrixWorldInverse).z;
    let image = sprite.material.map && sprite.material.map.image;
    if (depth > -1e-6 || size.y < 1e-6 || !image || !image.width) return null;
    let scale = pixels / -depth;
    let {x, y} = at.project(viewer.camera);
    return {
      image, depth, w: size.x * scale, h: size.y * scale,
      x: 0.5 * (1 + x) * overlay.clientWidth, y: 0.5 * (1 - y) * overlay.clientHeight,
    };
  }

  // Letters take 0.8 of the height of a label.
  function covers(a, b) {
    return 2 * Math.abs(a.x - b.x) < a.w + b.w && 2.5 * Math.abs(a.y - b.y) < a.h + b.h;
  }

  function place(label, here, taken) {
    let free = lines => {
      let there = {...here, y: here.y - 0.8 * lines * here.h};
      return taken.some(other => covers(there, other)) ? null : there;
    };
    let last = shifts.get(label) || 0;
    for (let k = 0; k <= 2 * taken.length + 1; ++k) {
      for (let lines of k ? [last + k, last - k] : [0, last]) {
        let there = free(lines);
        if (there) {
          shifts.set(label, lines);
          return there;
        }
      }
    }
    return here;
  }

  function write(labels) {
    let sharp = window.devicePixelRatio, {clientWidth: width, clientHeight: height} = overlay;
    if (overlay.width !== Math.round(width * sharp) || overlay.height !== Math.round(height * sharp)) {
      overlay.width = Math.round(width * sharp);
      overlay.height = Math.round(height * sharp);
    }
    let paint = overlay.getContext("2d");
    paint.setTransform(sharp, 0, 0, sharp, 0, 0);
    paint.clearRect(0, 0, width, height);
    let pixels = 0.5 * height * viewer.camera.projectionMatrix.elements[5];
    let taken = [];
    for (let label of labels) {
      let here = box(label, pixels);
      if (!here) continue;
      let there = place(label, here, taken);
      taken.push(there);
      if (Math.abs(there.y - here.y) > here.h) {
        paint.strokeStyle = "rgba(110, 110, 120, 0.8)";
        paint.beginPath();
        paint.moveTo(here.x, here.y + 0.4 * here.h);
        paint.lineTo(there.x, there.y);
        paint.stroke();
      }
      paint.drawImage(there.image, there.x - 0.5 * there.w, there.y - 0.5 * there.h, there.w, there.h);
    }
  }

  let drawn = viewer.render.bind(viewer);
  viewer.render = function () {
    let labels = words(), films = Boolean(viewer.animator.recording);  // which sees one canvas alone
    for (let {material} of labels) material.visible = films;
    drawn();
    write(films ? [] : labels);
  };
}
