//! The spelling of the configuration, and what is refused.

use super::*;

#[test]
fn the_spelling_of_every_key_is_kept() {
    // Catches a renamed key or value: configurations in the field would stop parsing.
    let text = r#"
        discriminators = ["f_max", "tau", "a_1", "pr", "p_f", "e_f"]
        index = "fused"
        re_inspect_rate = 0.02
        reject_rate = 0.001
        normalise_velocity = false
        [directions]
        f_max = "falls"
        tau = "rises"
        a_1 = "rises"
        a_2 = "rises"
        pr = "rises"
        p_f = "rises"
        e_f = "rises"
    "#;
    assert_eq!(toml::from_str::<FuseConfig>(text).unwrap(), FuseConfig::default());
    let again: FuseConfig = toml::from_str(&toml::to_string(&FuseConfig::default()).unwrap()).unwrap();
    assert_eq!(again, FuseConfig::default());
}

#[test]
fn one_key_changes_one_thing() {
    // Catches a missing serde default: naming one direction would unset or demand the others.
    let text = "reference = \"T 1/2\"\nindex = \"dissertation\"\ndirections = { pr = \"falls\" }";
    let config: FuseConfig = toml::from_str(text).unwrap();
    let expected = FuseConfig {
        reference: Some(Reference::Shoulder { tyre: Serial::new("T 1").unwrap(), shoulder: 2 }),
        index: IndexKind::Dissertation,
        directions: Directions::from(BTreeMap::from([(Discriminator::Pr, Direction::Falls)])),
        ..FuseConfig::default()
    };
    assert_eq!(config, expected);
}

#[test]
fn names_are_those_of_configurations() {
    // Catches a table that calls an index or a combination otherwise than a configuration does.
    for kind in IndexKind::ALL {
        let config: FuseConfig = toml::from_str(&format!("index = {:?}", kind.name())).unwrap();
        assert_eq!(config.index, kind);
    }
    for text in ["self", "T 1/2", "shift/sound.json"] {
        let config: FuseConfig = toml::from_str(&format!("reference = {text:?}")).unwrap();
        assert_eq!(config.reference.unwrap().to_string(), text);
    }
}

#[test]
fn what_is_not_understood_is_refused() {
    // Catches a typo in a configuration being ignored silently.
    for text in [
        "reject_at = 3.0", "directions = { prr = \"falls\" }", "directions = { pr = \"up\" }",
        "discriminators = [\"PR\"]", "index = \"mean\"", "reference = \"T1\"", "reference = \"T1/left\"",
        "reference = \"T1/2/2\"", "reference = \"/2\"", "reference = \"T1/70000\"",
    ] {
        assert!(toml::from_str::<FuseConfig>(text).is_err(), "{text}");
    }
}

#[test]
fn values_out_of_bounds_are_refused_by_name() {
    // Catches a bound that lets NaN or reversed limits through.
    let name_of = |config: FuseConfig| match config.validate() {
        Err(Error::OutOfRange { name, .. }) => name,
        other => panic!("{other:?}"),
    };
    let base = FuseConfig::default;
    for rate in [0.0, 0.6, f64::NAN] {
        assert_eq!(name_of(FuseConfig { re_inspect_rate: rate, ..base() }), "re_inspect_rate");
        assert_eq!(name_of(FuseConfig { reject_rate: rate, ..base() }), "reject_rate");
    }
    assert_eq!(
        FuseConfig { reject_rate: 0.021, ..base() }.validate().unwrap_err().to_string(),
        "fuse.reject_rate = 0.021: must not be above fuse.re_inspect_rate = 0.02"
    );
    assert_eq!(FuseConfig { discriminators: vec![], ..base() }.validate(), Err(Error::NoDiscriminators));
    let twice = FuseConfig { discriminators: vec![Discriminator::Pr, Discriminator::Pr], ..base() };
    assert_eq!(twice.validate(), Err(Error::TwiceListed { name: "pr" }));
    assert_eq!(base().validate(), Ok(()));
}
