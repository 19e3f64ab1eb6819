// Completes the record of a run that a crash left open.
(() => {
  "use strict";
  const { setText } = window.gyrobenchPage;
  const field = document.querySelector("#name");

  for (const button of document.querySelectorAll("[data-recover]")) {
    const wrong = button.parentElement.querySelector("[data-not-recovered]");
    button.addEventListener("click", async () => {
      const by = (field?.value || "").trim();
      if (field && !by) {
        setText(wrong, "Type your name at the top of the page first: it goes into the record.");
        field.focus();
        return;
      }
      button.disabled = true;
      setText(wrong, "");
      setText(button, "Completing the record");
      const run = button.dataset.recover.split("/").map(encodeURIComponent).join("/");
      const options = { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ by }) };
      const answer = await fetch(`/panel/recover/${run}`, options).catch(() => null);
      if (answer?.ok) return void location.reload();
      setText(wrong, answer ? await answer.text() : "The panel does not answer: is it still running?");
      setText(button, "Complete the record");
      button.disabled = false;
    });
    button.disabled = false;
  }
})();
