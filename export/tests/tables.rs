//! Exported tables, character by character.

use tapline_export::{Export, TableFile};
use tapline_store::{Codec, Lineage, Reader, Writer, hex_of};
use tapline_wire::SampleFormat;

use crate::common::{judgement, plan, put};
use crate::write;

fn exported(reader: &Reader, table: Export) -> String {
    let mut out = Vec::new();
    write(TableFile::csv(table, &mut out), reader);
    String::from_utf8(out).unwrap()
}

/// What the run of [`unfinished`] was given.
const GIVEN: Lineage<'static> = Lineage {
    config_toml: "[report]\nplant = \"P\"\nline = \"2\"\noperator = \"O\"\nprocedure = \"W 1\"\n[fuse]\nreference = \"sound.json\"\n",
    reference: Some("{\"digest\": \"4a\"}"),
    codec: Codec::Lz4,
    made_by: "program = \"x\"",
    raw: None,
};

/// A run in which row 3 was refused, row 9 never came, and only the first scan was judged.
pub(crate) fn unfinished(folder: &tempfile::TempDir) -> Reader {
    let path = folder.path().join("run.h5");
    let plan = plan(SampleFormat::I16);
    let mut writer = Writer::create(&path, &plan, plan.taps().len(), GIVEN).unwrap();
    for row in [0, 1, 2, 4, 5, 6, 7, 8] {
        put(&mut writer, row).unwrap();
    }
    let mut id = plan.taps()[3].id;
    id.attempt = 1;
    writer.put_refusal(3, &id, "force, 3 \"bounces\"").unwrap();
    writer.end_scan(0).unwrap();
    let (verdict, cells) = judgement(&plan, 0);
    writer.put_judgement(0, &verdict, &cells).unwrap();
    writer.finish().unwrap();
    Reader::open(&path).unwrap()
}

/// Catches a column that is renamed, moved or formatted differently, and an absent value that is not an empty cell.
#[test]
fn tables_to_the_letter() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let reader = unfinished(&folder);
    assert_eq!(
        exported(&reader, Export::Discriminators),
        "station,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition,attempt,purpose,tap_utc,\
         velocity_measured_m_per_s,f_max,tau_s,a_1,a_2,pr,p_f,e_f,centroid_hz,quality,force_unit,sound_unit\n\
         1,A\u{e9}-1,1,5,1.85,0,0,0,0,scan,1969-12-31 23:59:59.999,1.8333333333333335,0,0.125,0.25,0.375,0.5,0.625,0.75,0.875,,N,V\n\
         1,A\u{e9}-1,1,5,1.85,1,90,0,0,scan,1969-12-31 23:59:59.999,1.825,1,1.125,1.25,1.375,1.5,1.625,1.75,1.875,,N,V\n\
         1,A\u{e9}-1,1,5,1.85,2,180,0,0,scan,1969-12-31 23:59:59.999,1.82,,,,2.375,2.5,2.625,2.75,2.875,no_force,N,V\n\
         1,A\u{e9}-1,1,5,1.85,4,0,0,0,closing,1969-12-31 23:59:59.999,1.8142857142857143,4,4.125,4.25,4.375,4.5,4.625,4.75,4.875,,N,V\n\
         2,A\u{e9}-1,2,,1.85,0,,0,0,scan,,1.8125,,,,5.375,5.5,5.625,5.75,5.875,no_force,N,V\n\
         2,A\u{e9}-1,2,,1.85,1,,0,0,scan,1970-01-01 00:00:00.000,1.8111111111111111,6,6.125,6.25,6.375,6.5,6.625,6.75,6.875,,N,V\n\
         2,A\u{e9}-1,2,,1.85,2,,0,0,scan,1970-01-01 00:00:00.000,1.81,7,7.125,7.25,7.375,7.5,7.625,7.75,7.875,,N,V\n\
         2,A\u{e9}-1,2,,1.85,3,,0,0,scan,1970-01-01 00:00:00.000,1.809090909090909,,,,8.375,8.5,8.625,8.75,8.875,no_force,N,V\n"
    );
    assert_eq!(
        exported(&reader, Export::Damage),
        "tyre,shoulder,location,angle_deg,damage_index,first_index,p_value\n\
         A\u{e9}-1,1,0,0,4.5,,\nA\u{e9}-1,1,1,90,,,\nA\u{e9}-1,1,2,180,6.5,,0.25\nA\u{e9}-1,1,3,270,7.5,,\n"
    );
    assert_eq!(
        exported(&reader, Export::Regions),
        "tyre,shoulder,region,first_location,last_location,start_deg,end_deg,\
         peak_location,peak_angle_deg,peak_damage_index,extent_locations,extent_deg,\
         mean_damage_index,region_index,p_value,offset_best_mm,offset_low_mm,offset_high_mm\n\
         A\u{e9}-1,1,1,3,0,270,0,3,270,7.5,2,180,6,,,5,0,3\n"
    );
    assert_eq!(
        exported(&reader, Export::Verdicts),
        "tyre,shoulder,station,first_tap_utc,last_tap_utc,verdict,regions_deg,reasons,planned_count,archived_count,refused_count,missing_count,\
         second_reading_count,scan_s,absent_count,region_count,limit_re_inspect,limit_reject,strongest_arc,first_strongest_arc,re_inspect_rate,reject_rate,p_value,\
         evidence_f_max,evidence_tau,evidence_a_1,evidence_a_2,evidence_pr,evidence_p_f,evidence_e_f,evidence_centroid,\
         scatter_f_max,scatter_tau,scatter_a_1,scatter_a_2,scatter_pr,scatter_p_f,scatter_e_f,scatter_centroid,\
         level_f_max,level_tau,level_a_1,level_a_2,level_pr,level_p_f,level_e_f,level_centroid,\
         drift_f_max,drift_tau,drift_a_1,drift_a_2,drift_pr,drift_p_f,drift_e_f,drift_centroid\n\
         A\u{e9}-1,1,1,1969-12-31 23:59:59,1969-12-31 23:59:59,REJECT,270 to 0,damage|self_reference,5,4,1,0,0,4e-9,5,1,2.5,4,8.5,,0.02,0.001,0.004,\
         1,2,3,,5,6,7,8,,1.25,1.5,1.75,2,2.25,2.5,2.75,0.5,0.75,1,1.25,1.5,,2,2.25,0.01,0.02,,0.04,0.05,0.06,0.07,0.08\n\
         A\u{e9}-1,2,2,1970-01-01 00:00:00,1970-01-01 00:00:00,RE-INSPECT,,not_ended,5,4,0,1,0,2e-9,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,,\n"
    );
    let ledger = exported(&reader, Export::Ledger);
    let lines: Vec<&str> = ledger.lines().collect();
    assert_eq!(lines.len(), 11);
    assert_eq!(
        lines[0],
        "station,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition,state,attempt,reason,\
         retaken_count,retaken_for,lost_at"
    );
    assert_eq!(lines[3], "1,A\u{e9}-1,1,5,1.85,2,180,0,archived,0,,0,,");
    assert_eq!(lines[4], "1,A\u{e9}-1,1,5,1.85,3,270,0,refused,1,\"force, 3 \"\"bounces\"\"\",0,,");
    assert_eq!(lines[10], "2,A\u{e9}-1,2,,1.85,4,,0,missing,,,0,,acquire");
}

/// Catches a casing that is better than its worst shoulder, or without reasons of one; taps of one shoulder alone; and an origin that is
/// another's.
#[test]
fn a_casing_has_its_worst_verdict_and_where_it_comes_from() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let reader = unfinished(&folder);
    let written_by = reader.written_by().unwrap();
    let digests = format!("{},{}", hex_of(&reader.raw_digest().unwrap()), reader.lineage_key().unwrap());
    assert_eq!(
        exported(&reader, Export::Casings),
        format!(
            "tyre,station,first_tap_utc,last_tap_utc,verdict,reasons,shoulder_count,planned_count,archived_count,refused_count,missing_count,\
             plant,line,operator,procedure,reference,reference_digest,\
             force_unit,force_calibration,force_calibrated_on,force_valid_until,sound_unit,sound_calibration,sound_calibrated_on,sound_valid_until,\
             sample_rate_hz,written_by,raw_digest,lineage\n\
             A\u{e9}-1,1,1969-12-31 23:59:59,1970-01-01 00:00:00,REJECT,damage|not_ended|self_reference,2,10,8,1,1,\
             P,2,O,W 1,sound.json,4a,N,,,,V,,,,40960,{written_by},{digests}\n"
        )
    );
}

/// Catches a table that the command line cannot name.
#[test]
fn every_table_has_its_name() {
    let _guard = crate::common::beside_others();
    assert!(Export::ALL.into_iter().all(|table| Export::from_name(table.name()) == Some(table)));
    assert_eq!(Export::from_name("taps"), None);
}
