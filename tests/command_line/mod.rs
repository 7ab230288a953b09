//! Options, configurations and errors; the verbs that need no archive; the commands on the pages.

mod dissertation;
mod generated;
mod json;
mod model;
mod overwriting;
mod terminal;
mod usage;

use crate::sandbox::Sandbox;

/// A scan of casings whose shoulders are tapped at 20 places, so often.
fn small(repetitions: u32) -> String {
    format!(
        "[scan]\noffsets_mm = [0.0]\nvelocities_m_per_s = [1.0]\nrepetitions = {repetitions}\nlocations = 20\n\
         [fuse]\nreference = \"self\"\n"
    )
}

/// The casings SIM-0001 and SIM-0002 of such a scan, in the folder `x`.
fn scanned(repetitions: u32) -> Sandbox {
    let sandbox = Sandbox::new();
    sandbox.write("c.toml", &small(repetitions));
    sandbox.run("run --config c.toml --stations 2 --out x").expect(0);
    sandbox
}
