//! Stations that listen to a sound card: ALSA's plugin `file` plays what a simulated rig writes into a pipe.

use std::fs::File;
use std::io::Write as _;
use std::process::{Command, Stdio};

use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_model::SimulationConfig;
use tapline_store::{Reader, verify};
use tapline_testing::program::Done;
use tapline_wire::{CacheLine, TapHeader, cache_lines_for, i16_of_mut};

use crate::line::{file_of, reported, start_rig};
use crate::sandbox::running::{Running, until};
use crate::sandbox::{Sandbox, short_scan};

/// Samples of a record, in frames.
const RECORD: usize = 4096;

/// Configures the sound card `name`, which plays what is written into the pipe `name`.pcm, and exists once that does.
pub(crate) fn sound_card(sandbox: &Sandbox, name: &str) {
    let pipe = sandbox.path(&format!("{name}.pcm"));
    let card = format!("pcm.{name} {{ type file slave.pcm null file /dev/null infile {pipe:?} format raw }}");
    sandbox.write("asound.conf", &format!("pcm.null {{ type null }}\n{card}\n"));
}

pub(crate) fn plug_in(sandbox: &Sandbox, name: &str) {
    assert!(Command::new("mkfifo").arg(sandbox.path(&format!("{name}.pcm"))).status().unwrap().success());
}

fn start_line(sandbox: &Sandbox, casings: u32) -> Running {
    let arguments = format!("line --config plant.toml --out out --json --casings {casings}");
    let mut command = sandbox.command(&arguments);
    command.env("ALSA_CONFIG_PATH", sandbox.path("asound.conf"));
    Running::of(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
}

const CAPTURE: &str = "[capture]\nsample_rate_hz = 40960\npre_trigger_samples = 400\nsample_count = 3584\n\
    microphone_distance_m = 0.05\n[capture.trigger]\nlevel = 0.01\nhold_off_s = 0.05\n";

const CRACKED: &str = "[[scan.tyre]]\nserial = \"A\"\ncrack = [{ shoulder = 2, first_location = 10, location_count = 4, depth_mm = 6.0 }]\n";

/// Catches a tap that is missed, made twice or taken for another's, a casing that is not judged as its taps are, and a rig that
/// hits while nobody hears it.
#[test]
fn a_rig_is_heard_through_a_sound_card() {
    let sandbox = Sandbox::new();
    sound_card(&sandbox, "shoulder");
    let simulation = format!("[simulation]\nsample_count = {RECORD}\n");
    let rig =
        "casings = 2\nserials = [\"A\", \"B\"]\nplay = \"shoulder.pcm\"\nmissed_hits = 0.05\ndouble_hits = 0.05\n";
    let script = format!("{rig}{}seed = 4\n{CRACKED}{simulation}", short_scan(24));
    let (machine, address) = start_rig(&sandbox, &script);
    let station = format!("[[station]]\nnumber = 1\nsource = \"alsa\"\ndevice = \"shoulder\"\nrig = \"{address}\"\n");
    sandbox.write("plant.toml", &format!("{}{CAPTURE}{station}", short_scan(24)));
    let mut line = start_line(&sandbox, 2);
    line.wait_for_log(&["station 1", "shoulder", "not heard"]);
    std::thread::sleep(std::time::Duration::from_millis(500));
    plug_in(&sandbox, "shoulder");
    let verdicts = line.verdicts(2);
    let log = line.finish().expect(0).err;
    let report = machine.finish().expect(0).out;
    assert_eq!((&verdicts[0]["casing"], &verdicts[0]["shoulders"][1]["verdict"]), (&"A".into(), &"REJECT".into()));
    assert_eq!((&verdicts[1]["casing"], &verdicts[1]["verdict"]), (&"B".into(), &"PASS".into()), "{}", verdicts[1]);
    for verdict in &verdicts {
        assert_eq!((&verdict["archived"], &verdict["refused"]), (&50.into(), &0.into()), "{verdict}");
        assert!(verify(file_of(verdict)).unwrap().is_complete());
        let reader = Reader::open(file_of(verdict)).unwrap();
        // Each tap is of its own time, and in the order of the plan.
        let times: Vec<i64> = (0..50).map(|row| reader.tap(row).unwrap().unwrap().0.tap_time_ns).collect();
        assert!(times.is_sorted_by(|a, b| b - a > 50_000_000), "{times:?}");
    }
    eprintln!("{report}");
    let logged = |words: &str| log.lines().filter(|line| line.contains(words)).count();
    for (what, words) in [("missed hits", "nothing was heard"), ("double hits", "heard more than once")] {
        let made = reported(&report, what);
        assert!(made > 0 && logged(words) >= made, "{made} {what}, {}", logged(words));
    }
}

/// Catches taps by hand that are taken for those of other places, and a serial that is not read.
#[test]
fn taps_by_hand_come_in_the_order_of_the_plan() {
    let sandbox = Sandbox::new();
    sound_card(&sandbox, "hand");
    plug_in(&sandbox, "hand");
    let station = "[[station]]\nnumber = 3\nsource = \"alsa\"\ndevice = \"hand\"\nserial_file = \"serial.txt\"\n";
    sandbox.write("plant.toml", &format!("{}{CAPTURE}{station}", short_scan(24)));
    let scan: ScanConfig =
        toml::from_str(&format!("{}{CRACKED}", short_scan(24).replace("[scan]", "")).replace("scan.tyre", "tyre"))
            .unwrap();
    let simulation = SimulationConfig { sample_count: RECORD as u32, ..SimulationConfig::default() };
    let mut simulated = SimulatedLine::new(&scan, &simulation).unwrap();
    let mut line = start_line(&sandbox, 1);
    let mut pipe = File::create(sandbox.path("hand.pcm")).unwrap();
    until("the station listens", || sandbox.run("status --out out --json").out.contains("and its serial in "));
    sandbox.write("serial.txt", "A\n");
    let mut header = TapHeader::default();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(4 * RECORD)];
    pipe.write_all(&[0; 4 * RECORD]).unwrap();
    for row in 0..50 {
        simulated.render(row, 0, &mut header, &mut buffer).unwrap();
        let (force, sound) = i16_of_mut(&mut buffer)[..2 * RECORD].split_at(RECORD);
        let frames = force.iter().zip(sound).flat_map(|(f, s)| [f.to_le_bytes(), s.to_le_bytes()]).flatten();
        pipe.write_all(&frames.collect::<Vec<u8>>()).unwrap();
    }
    pipe.write_all(&[0; 4 * RECORD]).unwrap();
    let verdict = line.verdict();
    line.finish().expect(0);
    assert_eq!((&verdict["casing"], &verdict["station"], &verdict["archived"]), (&"A".into(), &3.into(), &50.into()));
    assert_eq!(
        (&verdict["shoulders"][0]["verdict"], &verdict["shoulders"][1]["verdict"]),
        (&"PASS".into(), &"REJECT".into())
    );
    let place = verdict["shoulders"][1]["peak_location"].as_u64().unwrap();
    assert!((10..14).contains(&place), "{verdict}");
    let table = sandbox.run(&format!("export {} discriminators", file_of(&verdict).display())).expect(0).out;
    assert_eq!(table.lines().count(), 51);
}

/// Catches a missing sound card that ends the line, or that is not reported.
#[test]
fn a_missing_sound_card_is_acknowledged_and_waited_for() {
    let sandbox = Sandbox::new();
    sandbox.write("asound.conf", "pcm.null { type null }\n");
    let station = "[[station]]\nnumber = 1\nsource = \"alsa\"\ndevice = \"absent\"\n";
    sandbox.write("plant.toml", &format!("{}{CAPTURE}{station}", short_scan(24)));
    let mut line = start_line(&sandbox, 1);
    line.wait_for_log(&["station 1", "absent", "not heard", "cannot be opened", "`tapline devices` lists"]);
    line.assert_runs();
    until("it is shown", || sandbox.run("status --out out").expect(0).out.contains("absent is not heard"));
    line.interrupt();
}

/// Catches an example that no longer runs to its end, whose taps are refused or taken again, or whose crack is not found.
#[test]
fn the_example_listens_to_its_rig() {
    let sandbox = Sandbox::new();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/listen/run.sh");
    // One that never ends is a failure too.
    let mut command = Command::new("timeout");
    command.args(["300", "sh"]).arg(script).arg(env!("CARGO_BIN_EXE_tapline")).arg(sandbox.path("listen"));
    let done = Done::from(command.stdin(Stdio::null()).output().unwrap()).expect(0);
    assert!(done.out.contains("REJECT     A-17/2") && done.out.contains("PASS       B-4/1"), "{done:?}");
    let faults = ["nothing was heard", "is taken again", "has lost"];
    assert!(faults.iter().all(|fault| !done.err.contains(fault)), "{}", done.err);
}
