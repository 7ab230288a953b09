//! Questions, on this host and on a cluster: the same rows, to the bit.

use std::path::Path;

use datafusion::arrow::util::pretty::pretty_format_batches;
use datafusion::prelude::{ParquetReadOptions, SessionContext};

use crate::cluster::Cluster;
use crate::sandbox::{CASINGS, Sandbox, TRUNCATED, tapline};

/// Every shape of a plan. Sums of fractions are taken within a file, whose rows are never shared out.
const QUESTIONS: [&str; 16] = [
    "SELECT * FROM verdicts",
    "SELECT * FROM casings",
    "SELECT * FROM taps",
    "SELECT * FROM discriminators",
    "SELECT * FROM damage",
    "SELECT * FROM regions",
    "SELECT file, location, damage_index FROM damage WHERE damage_index > 2 AND shoulder = 1",
    "SELECT count(*), count(error), count(DISTINCT tyre), min(f_max), max(tau_s) FROM discriminators",
    "SELECT file, state, count(*), sum(location), avg(angle_deg) FROM taps GROUP BY file, state",
    "SELECT verdict, count(*) FROM verdicts WHERE status = 'ok' GROUP BY verdict HAVING count(*) > 0",
    "SELECT d.file, d.location, d.pr, v.verdict FROM discriminators d JOIN verdicts v ON d.file = v.file AND d.shoulder = v.shoulder",
    "SELECT v.file, x.worst FROM verdicts v LEFT JOIN (SELECT file, max(damage_index) AS worst FROM damage GROUP BY file) x ON v.file = x.file",
    "SELECT substr(first_tap_utc, 1, 7) AS month, reason, count(*) FROM (SELECT first_tap_utc, unnest(string_to_array(reasons, '|')) AS reason FROM verdicts WHERE status = 'ok') GROUP BY month, reason",
    "SELECT tyre FROM taps UNION ALL SELECT tyre FROM damage",
    "SELECT file FROM verdicts UNION SELECT file FROM damage",
    "SELECT file, damage_index, row_number() OVER (PARTITION BY file ORDER BY damage_index DESC, shoulder, location) AS place FROM damage ORDER BY damage_index DESC, file, shoulder, location LIMIT 7",
];

/// Catches rows that are done by every task (N times as many), lost or doubled between partitions, and altered on their way.
#[test]
fn a_cluster_answers_like_this_host() {
    let Some(sandbox) = Sandbox::new() else { return };
    sandbox.truncate_one();
    let cluster = Cluster::start(&sandbox, &tapline().unwrap());
    for sql in QUESTIONS {
        // Six partitions of two files.
        let [local, remote] =
            ["local", &cluster.engine].map(|engine| sandbox.ask(sql, engine, &["--files-per-task", "2"]));
        assert!(local.len() > 1, "{sql}");
        assert_eq!(local, remote, "{sql}");
        // However the files are shared out.
        assert_eq!(local, sandbox.ask(sql, "local", &["--files-per-task", "5"]), "{sql}");
    }
    copies_are_the_same(&sandbox, &cluster);
}

fn copies_are_the_same(sandbox: &Sandbox, cluster: &Cluster) {
    let copies = ["local", &cluster.engine].map(|engine| {
        let out = sandbox.path(if engine == "local" { "copy-local" } else { "copy-cluster" });
        let sql =
            format!("COPY (SELECT * FROM discriminators WHERE location > 3) TO '{}/' STORED AS PARQUET", out.display());
        let rows = sandbox.ask(&sql, engine, &["--files-per-task", "3"]);
        // What was copied can be asked about too; no archive is read for it.
        let sql = format!("SELECT count(*) FROM '{}/'", out.display());
        let asked = sandbox.run(&["sql", &sql, "in", "--format", "csv", "--engine", engine]).expect(0);
        let copied = parquet_rows(&out);
        assert_eq!(asked.out.lines().last(), Some(&*copied.len().to_string()));
        (rows, copied)
    });
    assert!(copies[0].1.len() > 100);
    assert_eq!(copies[0], copies[1]);
}

/// The rows of the Parquet files in a folder, sorted.
fn parquet_rows(folder: &Path) -> Vec<String> {
    let read = async {
        let context = SessionContext::new();
        let options = ParquetReadOptions::default();
        context.read_parquet(folder.to_str().unwrap(), options).await.unwrap().collect().await.unwrap()
    };
    let batches = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(read);
    let text = pretty_format_batches(&batches).unwrap().to_string();
    let mut lines: Vec<_> = text.lines().filter(|line| line.contains(".h5")).map(str::to_owned).collect();
    lines.sort();
    lines
}

/// Catches results of several references that are put together without a word, and a word that was not wanted.
#[test]
fn results_that_were_not_made_alike_are_said() {
    let Some(sandbox) = Sandbox::new() else { return };
    for (archive, reference) in [("SIM-0001", "self"), ("SIM-0002", "SIM-0002/1")] {
        let mut command = std::process::Command::new(tapline().unwrap());
        command.args(["reprocess", "--quiet", "--reference", reference]);
        assert!(command.arg(sandbox.path(&format!("in/1/{archive}.h5"))).output().unwrap().status.success());
    }
    let asked = |more: &[&str]| {
        let arguments = ["sql", "SELECT count(*) FROM verdicts", "in", "--results"];
        sandbox.run(&[&arguments[..], more].concat()).expect(0).err
    };
    let err = asked(&[]);
    assert!(err.contains("in: the newest results were not all made alike: 1/SIM-0001."), "{err}");
    assert_eq!(asked(&["-q"]), "");
}

/// Catches a formula from a tyre's name, a number that becomes a text, and a row of JSON in which a column is missing.
#[test]
fn rows_are_texts_for_spreadsheets_and_whole_for_programs() {
    let Some(sandbox) = Sandbox::new() else { return };
    let sql = "SELECT '=1+1' AS a, -5.5 AS b, arrow_cast(NULL, 'Float64') AS c";
    let printed = |format: &str| sandbox.run(&["sql", sql, "in", "--format", format]).expect(0).out;
    assert_eq!(printed("csv"), "a,b,c\n'=1+1,-5.5,\n");
    assert_eq!(printed("json"), "{\"a\":\"=1+1\",\"b\":-5.5,\"c\":null}\n");
}

/// Catches a job that ends for one bad file, and a file that is left out without a word.
#[test]
fn an_archive_that_was_cut_off_is_a_row_with_its_error() {
    let Some(sandbox) = Sandbox::new() else { return };
    sandbox.truncate_one();
    let bad = sandbox.ask("SELECT file, tyre, error FROM verdicts WHERE status = 'error'", "local", &[]);
    assert_eq!(bad.len(), 2);
    assert!(bad[1].starts_with(&format!("{TRUNCATED},,")) && bad[1].contains("it is shorter than it says"), "{bad:?}");
    let good = sandbox.ask("SELECT count(DISTINCT file) FROM verdicts WHERE status = 'ok'", "local", &[]);
    assert_eq!(good[1], CASINGS.to_string());
}

#[test]
fn what_cannot_be_asked_is_said() {
    let Some(sandbox) = Sandbox::new() else { return };
    sandbox.truncate_one();
    let refusal = |arguments: &[&str]| sandbox.run(arguments).expect(1).err;
    let err = refusal(&["sql", "SELECT damage FROM damage", "in"]);
    assert!(
        err.contains("cannot plan \"SELECT damage FROM damage\" over the tables discriminators, ")
            && err.contains("No field named damage"),
        "{err}"
    );
    for statement in ["DROP TABLE verdicts", "CREATE TABLE t AS SELECT 1", "SET datafusion.execution.batch_size = 1"] {
        let err = refusal(&["sql", statement, "in"]);
        assert!(err.contains("not supported"), "{statement}: {err}");
    }
    let err = refusal(&["sql", "SELECT 1", "nowhere"]);
    assert!(err.contains("cannot read nowhere"), "{err}");
    let err = refusal(&["sql", "SELECT * FROM damage", "in", "--engine", "cluster://127.0.0.1:1"]);
    assert!(err.contains("the query failed on cluster://127.0.0.1:1"), "{err}");
    // An archive, another file, a folder with files, a place where no file can be, and one that is no file.
    let archive = sandbox.path("in").join(TRUNCATED).display().to_string();
    let before = std::fs::read(&archive).unwrap();
    for (target, words) in [
        (archive.as_str(), "nothing takes its place"),
        (&format!("{archive}/"), "nothing takes its place"),
        ("in/", "has files already"),
        ("/proc/x.csv", "no file can be made in /proc"),
        ("s3://plant/x/", "is not the path of one"),
        ("in/[x].csv", "is not the path of one"),
        (&format!("file:{archive}"), "nothing takes its place"),
        (&format!("file://localhost{archive}"), "nothing takes its place"),
        (&format!("gone/../in/{TRUNCATED}"), "nothing takes its place"),
    ] {
        for statement in ["COPY (SELECT 1) TO", "EXPLAIN ANALYZE COPY (SELECT 1) TO"] {
            let err = refusal(&["sql", &format!("{statement} '{target}' STORED AS CSV"), "in"]);
            assert!(err.contains(words), "{target}: {err}");
        }
    }
    assert_eq!(std::fs::read(&archive).unwrap(), before);
    let sql = "COPY (SELECT 1) TO 'found/' STORED AS CSV";
    let err = refusal(&["sql", sql, "in", "--engine", "cluster://127.0.0.1:1"]);
    assert!(err.contains("cluster"), "{err}");
    // What is new is written, and what an explanation names is not.
    std::fs::create_dir(sandbox.path("empty")).unwrap();
    for target in ["new.csv", "new/", "empty/"] {
        sandbox.run(&["sql", &format!("COPY (SELECT 1) TO '{target}' STORED AS CSV"), "in"]).expect(0);
        assert!(sandbox.path(target).exists());
        sandbox.run(&["sql", &format!("EXPLAIN COPY (SELECT 1) TO '{target}' STORED AS CSV"), "in"]).expect(0);
    }
    // What is there already is only read.
    let before = sandbox.names("new");
    for statement in ["INSERT INTO 'new/' SELECT 2", "EXPLAIN ANALYZE INSERT INTO 'new/' SELECT 2"] {
        let err = refusal(&["sql", statement, "in"]);
        assert!(err.contains("tables are only read"), "{statement}: {err}");
    }
    assert_eq!(sandbox.names("new"), before);
}
