// SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
// SPDX-License-Identifier: Apache-2.0
//
// What viser's page cannot do itself. The server sends it with each connection; `$LARGEST_FILE` and
// `$REFUSAL` are filled in.
(() => {
  const dark = matchMedia('(prefers-color-scheme: dark)').matches;
  try {
    localStorage.setItem('viser-user:$SYSTEM_IS_DARK', dark ? 'yes' : 'no');
  } catch {
    // storage is blocked: the page stays light until its button is pressed
  }
  if (window.isSoftbodyPage) return; // it has connected again
  window.isSoftbodyPage = true;

  // On phones viser's panel covers most of the picture: each one that appears is folded, once.
  const folded = new WeakSet();
  const foldPanel = () => {
    if (!matchMedia('(max-width: 36em)').matches) return;
    const handle = document.querySelector('div[style*="cursor: pointer"][style*="height: 3.5em"]');
    if (handle === null || folded.has(handle)) return;
    folded.add(handle);
    handle.click();
  };
  new MutationObserver(foldPanel).observe(document.body, { childList: true, subtree: true });
  foldPanel();

  // A button that was clicked keeps the focus, and the space bar would press it once more.
  document.addEventListener('click', (event) => {
    if (event.detail > 0) event.target.closest('button')?.blur();
  });

  // Files that are dropped go to the upload button that takes their type.
  const veil = document.createElement('div');
  veil.textContent = 'Drop a mesh or a scene file';
  veil.style.cssText =
    'position:fixed;inset:1em;z-index:1000;display:none;place-items:center;pointer-events:none;' +
    'border:0.2em dashed #d96c2e;border-radius:1em;background:rgba(217,108,46,0.15);' +
    'font:600 1.5em sans-serif;color:#d96c2e';
  document.body.append(veil);
  let hiding;
  document.addEventListener('dragover', (event) => {
    if (!event.dataTransfer.types.includes('Files')) return;
    event.preventDefault();
    veil.style.display = 'grid';
    clearTimeout(hiding); // the event repeats while the file is above the page
    hiding = setTimeout(() => (veil.style.display = 'none'), 500);
  });
  document.addEventListener('drop', (event) => {
    if (!event.dataTransfer.types.includes('Files')) return;
    event.preventDefault();
    veil.style.display = 'none';
    // one at a time: viser's button holds the last one
    for (const file of event.dataTransfer.files) {
      const ending = '.' + file.name.split('.').pop().toLowerCase();
      const input = [...document.querySelectorAll('input[type=file]')].find((each) =>
        each.accept.split(',').includes(ending),
      );
      if (input === undefined) continue;
      const files = new DataTransfer();
      files.items.add(file);
      input.files = files.files;
      input.dispatchEvent(new Event('change', { bubbles: true }));
      return;
    }
    const name = event.dataTransfer.files[0]?.name ?? 'This';
    alert(`${name} is neither a mesh (STL, OBJ, PLY, OFF, GLB, DAE) nor a scene file (YAML).`);
  });

  // before viser sends it
  document.addEventListener(
    'change',
    (event) => {
      const file = event.target.type === 'file' ? event.target.files[0] : undefined;
      if (file === undefined || file.size <= $LARGEST_FILE) return;
      event.stopImmediatePropagation();
      alert(`${file.name} has ${Math.ceil(file.size / 1e6)} MB: $REFUSAL`);
    },
    true,
  );
})();
