// A bar for a motion, which rests at its start: play and pause, time and speed, of meshcat's animator.

{
  let bar = document.getElementById("player");
  if (viewer.animator.duration) {
    let [button, time, clock, speed, times] = ["play", "time", "clock", "speed", "times"].map(
      name => bar.querySelector("." + name));
    bar.style.display = "flex";
    viewer.animator.pause();
    viewer.animator.seek(0);
    viewer.animator.display_progress(0);
    time.max = viewer.animator.duration;

    let said = seconds => (bar.dataset.speed * seconds).toFixed(3) + " s";
    let runs = () => viewer.animator.playing;
    button.onclick = () => runs() ? viewer.animator.pause() : viewer.animator.play();
    time.oninput = () => {
      if (runs()) viewer.animator.pause();
      viewer.animator.seek(+time.value);
      viewer.animator.display_progress(+time.value);
    };
    speed.oninput = () => {
      viewer.animator.mixer.timeScale = 2 ** speed.value;
      times.textContent = (2 ** speed.value).toPrecision(2) + " x";
    };
    window.addEventListener("keydown", event => {
      if (event.key !== " " || event.target !== document.body) return;
      event.preventDefault();
      button.onclick();
    });
    // Called from the loop of pictures, a few times a second.
    bar.tell = seconds => {
      button.textContent = runs() ? "\u275a\u275a" : "\u25b6";
      time.value = seconds;
      clock.textContent = said(seconds);
    };
  }
}
