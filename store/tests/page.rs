//! The page on the layout of an archive says what a new archive is.

use std::collections::BTreeMap;

use hdf5::types::{FixedUnicode, FloatSize, IntSize, TypeDescriptor};
use hdf5::{Dataset, File, Location};
use tapline_store::{Lineage, Reader, Writer};
use tapline_testing::documents;
use tapline_wire::{Quality, Reasons, SampleFormat};

use crate::common::{CONFIG, new_path, plan};

/// What is at a place: (type, unit), by path and by the name of a field or, behind an `@`, of an attribute.
type Found = BTreeMap<(String, String), (String, String)>;

fn page() -> String {
    documents::text(&documents::docs("archive-layout.md"))
}

/// Types as the page writes them.
fn type_name(of: &TypeDescriptor) -> String {
    let bits = |size: &IntSize| 8 * *size as usize;
    match of {
        TypeDescriptor::Integer(size) => format!("i{}", bits(size)),
        TypeDescriptor::Unsigned(size) => format!("u{}", bits(size)),
        TypeDescriptor::Float(FloatSize::U4) => "f32".to_owned(),
        TypeDescriptor::Float(FloatSize::U8) => "f64".to_owned(),
        TypeDescriptor::FixedArray(of, count) => format!("{}[{count}]", type_name(of)),
        TypeDescriptor::FixedUnicode(bytes) => format!("utf8[{bytes}]"),
        TypeDescriptor::FixedAscii(bytes) => format!("ascii[{bytes}]"),
        other => panic!("{other:?}"),
    }
}

fn text(place: &Location, name: &str) -> String {
    let attribute = place.attr(name).unwrap();
    match attribute.dtype().unwrap().to_descriptor().unwrap() {
        TypeDescriptor::FixedUnicode(32) => attribute.read_scalar::<FixedUnicode<32>>().unwrap().to_string(),
        TypeDescriptor::FixedUnicode(128) => attribute.read_scalar::<FixedUnicode<128>>().unwrap().to_string(),
        TypeDescriptor::FixedUnicode(512) => attribute.read_scalar::<FixedUnicode<512>>().unwrap().to_string(),
        other => panic!("{name}: {other:?}"),
    }
}

/// Adds the attributes of `place` but those that every table has.
fn add_attributes(found: &mut Found, path: &str, place: &Location) {
    for name in place.attr_names().unwrap() {
        if name == "note" || name == "units" || name.starts_with("units_") {
            continue;
        }
        let attribute = place.attr(&name).unwrap();
        let length: String = attribute.shape().iter().map(|n| format!("[{n}]")).collect();
        let of = type_name(&attribute.dtype().unwrap().to_descriptor().unwrap());
        found.insert((path.to_owned(), format!("@{name}")), (of + &length, String::new()));
    }
}

fn add_dataset(found: &mut Found, path: &str, dataset: &Dataset) {
    add_attributes(found, path, dataset);
    found.insert((path.to_owned(), String::new()), Default::default());
    let TypeDescriptor::Compound(row) = dataset.dtype().unwrap().to_descriptor().unwrap() else { return };
    let mut listed = Vec::new();
    for field in row.fields {
        let units = format!("units_{}", field.name);
        let has_unit = dataset.attr_names().unwrap().contains(&units);
        let unit = if has_unit { text(dataset, &units) } else { String::new() };
        if has_unit {
            listed.push(format!("{} {unit}", field.name));
        }
        found.insert((path.to_owned(), field.name), (type_name(&field.ty), unit));
    }
    let of_fields = dataset.attr_names().unwrap().iter().filter(|name| name.starts_with("units_")).count();
    assert_eq!(of_fields, listed.len(), "{path}: a unit of no field");
    if !listed.is_empty() {
        // The list is in an order of its own.
        let mut units: Vec<String> = text(dataset, "units").split(", ").map(str::to_owned).collect();
        units.sort();
        listed.sort();
        assert_eq!(units, listed, "{path}");
    }
}

/// What an archive with everything has, and a file of only results beside it.
fn found_in_files() -> Found {
    let folder = tempfile::tempdir().unwrap();
    let (path, results) = (folder.path().join("run.h5"), folder.path().join("results.h5"));
    let plan = plan(SampleFormat::I16);
    let whole = Lineage { reference: Some("{}"), ..CONFIG.into() };
    Writer::create(&path, &plan, plan.taps().len(), whole).unwrap().finish().unwrap();
    let raw = Some((path.as_path(), Reader::open(&path).unwrap().raw_digest().unwrap()));
    Writer::create(&results, &plan, plan.taps().len(), Lineage { raw, ..whole }).unwrap().finish().unwrap();
    let mut found = Found::new();
    add_attributes(&mut found, "", &File::open(&results).unwrap());
    let file = File::open(&path).unwrap();
    add_attributes(&mut found, "", &file);
    for name in file.member_names().unwrap() {
        if let Ok(dataset) = file.dataset(&name) {
            add_dataset(&mut found, &name, &dataset);
            continue;
        }
        let group = file.group(&name).unwrap();
        found.insert((name.clone(), String::new()), Default::default());
        add_attributes(&mut found, &name, &group);
        for member in group.member_names().unwrap() {
            add_dataset(&mut found, &format!("{name}/{member}"), &group.dataset(&member).unwrap());
        }
    }
    found
}

/// What the page says there is.
fn said_on_page(page: &str) -> Found {
    let mut said = Found::new();
    let (mut path, mut mark) = (None, "");
    for line in page.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            path = match heading.strip_prefix('`').and_then(|name| name.strip_suffix('`')) {
                Some(name) => {
                    said.insert((name.to_owned(), String::new()), Default::default());
                    Some(name)
                }
                None => (heading == "The root").then_some(""),
            };
        }
        if line.starts_with("| field |") {
            mark = "";
        } else if line.starts_with("| attribute |") {
            mark = "@";
        } else if let (Some(path), Some(row)) = (path, line.strip_prefix("| `")) {
            let cells: Vec<&str> = row.split('|').map(str::trim).collect();
            let name = format!("{mark}{}", cells[0].trim_end_matches('`'));
            // What a name's suffix says of an attribute is for people; what another attribute says is not a unit.
            let unit = if mark == "@" || cells[2].starts_with("see ") { "" } else { cells[2] };
            let before = said.insert((path.to_owned(), name), (cells[1].to_owned(), unit.to_owned()));
            assert_eq!(before, None, "twice: {path} {line}");
        }
    }
    said
}

/// Catches what is in a file and not on the page, what is on the page and in no file, and another type or unit.
#[test]
fn the_page_names_what_is_there() {
    let _guard = crate::common::beside_others();
    let (found, said) = (found_in_files(), said_on_page(&page()));
    for (place, what) in &found {
        assert_eq!(said.get(place), Some(what), "{place:?} on the page");
    }
    for place in said.keys() {
        assert!(found.contains_key(place), "{place:?} is in no file");
    }
    assert!(found.len() > 120, "{}", found.len());
}

/// Catches a flag that the page lacks, or has under another number.
#[test]
fn the_page_names_every_flag() {
    let page = page();
    let rows_of = |heading: &str| -> Vec<(u32, String)> {
        let section = page.split(&format!("\n### {heading}\n")).nth(1).unwrap().split("\n#").next().unwrap();
        let rows = section.lines().filter_map(|line| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            let number = cells.get(1)?.parse().ok()?;
            Some((number, cells[2].trim_matches('`').to_owned()))
        });
        rows.collect()
    };
    let quality: Vec<_> = Quality::ALL.iter().map(|(flag, name)| (flag.bits(), (*name).to_owned())).collect();
    let reasons: Vec<_> = Reasons::ALL.iter().map(|(flag, name)| (flag.bits(), (*name).to_owned())).collect();
    assert_eq!((rows_of("quality"), rows_of("reasons")), (quality, reasons));
}

/// Catches hints for other viewers that point at nothing.
#[test]
fn hints_lead_to_the_samples() {
    let (_here, path) = new_path();
    Writer::create(&path, &plan(SampleFormat::F32), 0, CONFIG).unwrap().finish().unwrap();
    let file = File::open(&path).unwrap();
    let group = file.group(&text(&file, "default")).unwrap();
    let signal = group.dataset(&text(&group, "signal")).unwrap();
    let axes = group.attr("axes").unwrap().read_raw::<FixedUnicode<32>>().unwrap();
    assert_eq!((text(&file, "NX_class"), text(&group, "NX_class")), ("NXroot".to_owned(), "NXdata".to_owned()));
    assert!(axes.len() == signal.ndim() && axes.iter().all(|axis| axis.as_str() == "."));
    assert_eq!((text(&signal, "channels"), text(&signal, "channel_units")), ("force,sound".into(), "N,V".into()));
}
