// Words are drawn over the picture, of one height on the screen, and as sharp as that is: also while the
// picture itself has fewer pixels, in a motion. A label stands beside its point, on the right; one that
// would cover another goes to the left, or up or down to the nearest free place, from picture to picture
// as little as it can. A thin line leads back to its point.

{
  let overlay = document.getElementById("labels");
  let kept = new Map();  // of labels: side, and lines upwards

  // Pictures of words come when they are decoded, after the page.
  function words() {
    let found = [];
    viewer.scene.traverse(object => { if (object.isSprite) found.push(object); });
    return found;
  }

  // The point of a label on the screen [px], if it is to be seen, and the size of the label.
  function spot(sprite, height) {
    let at = sprite.getWorldPosition(new MeshCat.THREE.Vector3());
    let size = sprite.getWorldScale(new MeshCat.THREE.Vector3());
    let depth = at.clone().applyMatrix4(viewer.camera.matrixWorldInverse).z;
    let image = sprite.material.map && sprite.material.map.image;
    if (depth > -1e-6 || size.y < 1e-6 || !image || !image.width) return null;
    let {x, y} = at.project(viewer.camera);
    return {
      image, w: height * image.width / image.height, h: height,
      x: 0.5 * (1 + x) * overlay.clientWidth, y: 0.5 * (1 - y) * overlay.clientHeight,
    };
  }

  // Letters fill 0.8 of the height of a label.
  function covers(a, b) {
    return 2 * Math.abs(a.x - b.x) < a.w + b.w && 2.5 * Math.abs(a.y - b.y) < a.h + b.h;
  }

  function place(label, point, taken) {
    let at = (side, lines) => {
      let {w, h} = point, away = 0.5 * w + 0.6 * h;
      return {...point, x: point.x + side * away, y: point.y - (0.3 + 0.8 * lines) * h};
    };
    let inside = ({x, w}) => x > 0.5 * w && x + 0.5 * w < overlay.clientWidth;
    let free = there => inside(there) && !taken.some(other => covers(there, other));
    let [side, lines] = kept.get(label) || [1, 0];
    for (let k = 0; k <= 2 * taken.length + 1; ++k) {
      for (let each of k ? [[side, lines + k], [side, lines - k], [-side, lines + k], [-side, lines - k]]
                         : [[1, 0], [side, lines], [-1, 0]]) {
        let there = at(...each);
        if (free(there)) {
          kept.set(label, each);
          return there;
        }
      }
    }
    return at(side, lines);
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
    let tall = Math.min(24, Math.max(18, 0.025 * height));  // [px] of a line, also in a small window
    let taken = [], placed = [];
    for (let label of labels) {
      let point = spot(label, tall);
      if (!point) continue;
      let there = place(label, point, taken);
      taken.push(there);
      placed.push([point, there]);
    }
    paint.strokeStyle = "rgba(110, 110, 120, 0.7)";
    for (let [point, there] of placed) {
      paint.beginPath();
      paint.moveTo(point.x, point.y);
      paint.lineTo(there.x - Math.sign(there.x - point.x) * 0.5 * there.w, there.y);
      paint.stroke();
    }
    paint.fillStyle = "rgba(255, 255, 255, 0.6)";
    for (let [, {x, y, w, h}] of placed) paint.fillRect(x - 0.5 * w, y - 0.4 * h, w, 0.8 * h);
    for (let [, {image, x, y, w, h}] of placed) paint.drawImage(image, x - 0.5 * w, y - 0.5 * h, w, h);
  }

  let drawn = viewer.render.bind(viewer);
  viewer.render = function () {
    let labels = words(), films = Boolean(viewer.animator.recording);  // which sees one canvas alone
    for (let {material} of labels) material.visible = films;
    drawn();
    write(films ? [] : labels);
  };
}
