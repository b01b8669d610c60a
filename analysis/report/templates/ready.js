document.documentElement.dataset.ready = "yes"; // what draws has been run
