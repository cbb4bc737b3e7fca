// Dots of figures that say under the cursor which keys of a scene they are of: a click copies them.
(() => {
"use strict";
for (const note of document.querySelectorAll("svg .note")) {
  const keys = note.querySelector("title").textContent;
  note.onclick = () => {
    const caption = note.closest("figure").querySelector("figcaption");
    let told = caption.querySelector(".copied");
    if (!told) { told = document.createElement("pre"); told.className = "copied"; caption.append(told); }
    told.textContent = keys;
    // A page that must not copy has the keys there, chosen.
    const chosen = () => getSelection().selectAllChildren(told);
    navigator.clipboard?.writeText(keys).then(() => { told.dataset.copied = "yes"; }, chosen) ?? chosen();
  };
}
})();
