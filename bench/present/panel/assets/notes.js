// Notes and pictures of recorded runs: a picture is made small enough to send before it leaves this browser.
(() => {
  "use strict";
  const { element, place, recallName, setText } = window.gyrobenchPage;
  const MOST_PIXELS = 2400;
  const field = place("#name");
  if (field) recallName(field);

  // Drawn anew at most 2,400 pixels wide and high: what a phone writes into its pictures (place, owner) stays behind.
  async function smaller(file) {
    const image = await createImageBitmap(file);
    const share = Math.min(1, MOST_PIXELS / Math.max(image.width, image.height));
    const canvas = Object.assign(document.createElement("canvas"), { width: Math.round(image.width * share), height: Math.round(image.height * share) });
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    const kind = file.type === "image/png" ? "image/png" : "image/jpeg";
    return canvas.toDataURL(kind, 0.88).split(",")[1];
  }

  function fill(list, run, notes) {
    list.replaceChildren(...notes.map((note) => {
      const row = element("li");
      row.append(element("p", "by", `${note.by}, ${note.utc} UTC`));
      if (note.text) row.append(element("p", "text", note.text));
      if (note.picture) {
        const link = element("a");
        link.href = `/panel/picture/${note.picture}?name=${encodeURIComponent(run)}`;
        link.append(Object.assign(element("img"), { alt: note.text || `Picture by ${note.by}`, src: link.href }));
        row.append(link);
      }
      return row;
    }));
  }

  for (const section of document.querySelectorAll("[data-notes]")) {
    const form = section.querySelector("form");
    if (!form) continue;
    const wrong = form.querySelector("[data-wrong]");
    const word = form.querySelector(".file > span");
    form.picture.addEventListener("change", () => setText(word, form.picture.files[0]?.name ?? "Add a picture"));
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      const by = (field.value || "").trim();
      if (!by) {
        setText(wrong, "Type your name at the top of the page first: it stands under the note.");
        field.focus();
        return;
      }
      form.querySelector("button").disabled = true;
      try {
        const file = form.picture.files[0];
        const body = JSON.stringify({ by, text: form.text.value, picture: file ? await smaller(file) : "" });
        const answer = await fetch(`/panel/notes/${section.dataset.notes.split("/").map(encodeURIComponent).join("/")}`, { method: "POST", headers: { "content-type": "application/json" }, body });
        if (!answer.ok) throw new Error(await answer.text());
        fill(section.querySelector("[data-list-of-notes]"), section.dataset.notes, await answer.json());
        form.reset();
        setText(word, "Add a picture");
        setText(wrong, "");
      } catch (error) {
        setText(wrong, error instanceof DOMException ? "This file is no picture that the browser can read: take a PNG or JPEG." : error.message);
      }
      form.querySelector("button").disabled = false;
    });
    form.querySelector("button").disabled = false;
  }
})();
