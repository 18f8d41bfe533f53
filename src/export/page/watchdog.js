// The watchdog: runs before all else, and says so if this page is damaged, was cut, or does not go on.
(() => {
  /** Milliseconds between looks, and without progress after which the page says so. */
  const [PERIOD_MS, STALL_MS] = [5000, 60000];
  const AGAIN = 'Export or download it again.';
  const expected = Number(document.querySelector('meta[name="headbox-bytes"]').content);
  const parts = () => [...document.querySelectorAll('script[id^="part-"]')];
  // The viewer frees the text of a part that it has read, and notes its size.
  const sizeOf = (part) => Number(part.dataset.bytes) || new Blob([part.textContent]).size;
  const bytes = () => `expected ${expected} bytes of data, found ${parts().reduce((sum, part) => sum + sizeOf(part), 0)}`;
  const isOver = () => 'loadedMs' in document.body.dataset || document.body.classList.contains('failed');

  function say(text) {
    let status = document.getElementById('status');
    if (!status) {
      const bar = document.body.appendChild(document.createElement('div'));
      bar.id = 'bar';
      status = bar.appendChild(document.createElement('span'));
      status.id = 'status';
    }
    status.textContent = text;
    return status;
  }

  function fail(text) {
    document.body.dataset.damage = text;
    document.body.classList.add('failed');
    const progress = document.getElementById('progress');
    if (progress) progress.hidden = true;
    say(text).setAttribute('role', 'alert');
  }

  document.documentElement.classList.add('watched');
  document.addEventListener('DOMContentLoaded', () => {
    if (!document.getElementById('end')) fail(`This page is damaged or was cut: ${bytes()}. ${AGAIN}`);
  });
  addEventListener('load', () => {
    if ('viewer' in document.body.dataset || isOver()) return;
    fail(`This page is damaged, or this browser is too old for it: its viewer does not start (${bytes()}). ${AGAIN}`);
  });
  let [before, since] = ['', performance.now()];
  const timer = setInterval(() => {
    if (!document.body) return;
    if (isOver()) {
      clearInterval(timer);
      return;
    }
    const found = parts();
    const progress = document.getElementById('progress');
    const now = [found.length, found.length && found[found.length - 1].textContent.length, progress && progress.value].join();
    if (now !== before) [before, since] = [now, performance.now()];
    else if (performance.now() - since < STALL_MS) return;
    else if (document.readyState === 'loading') say(`The rest of this page does not come: ${bytes()}. Load it again.`);
    else say(`This page has not gone on for a minute (${bytes()}). Load it again, or in another browser.`);
  }, PERIOD_MS);
})();
