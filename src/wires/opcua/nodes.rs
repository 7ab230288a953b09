//! The address space: the types of OPC 40001-101 that are used, and the line's `ResultManagement` with its stations.

use opcua::nodes::{
    DataTypeBuilder, EventNotifier, MethodBuilder, NodeInsertTarget, ObjectBuilder, ObjectTypeBuilder,
    ReferenceDirection, VariableBuilder, VariableTypeBuilder,
};
use opcua::types::{
    Argument, DataTypeDefinition, DataTypeId, EnumDefinition, EnumField, LocalizedText, NodeId, ObjectId, ObjectTypeId,
    QualifiedName, ReferenceTypeId, StructureDefinition, StructureField, StructureType, VariableTypeId, Variant,
};

use crate::wires::opcua::names::{Namespaces, id};

/// A structure's field: name, type, whether it is an array, and whether it is optional.
type Field = (&'static str, NodeId, bool, bool);

/// Names of the evaluations, in the order of their numbers.
const EVALUATIONS: [&str; 4] = ["Undefined", "OK", "NotOK", "NotDecidable"];

/// Adds the types.
pub(super) fn add_types(space: &mut impl NodeInsertTarget, ns: Namespaces) {
    let name = |name: &str| QualifiedName::new(ns.result, name);
    let of = |id| ns.of_result(id);
    ObjectTypeBuilder::new(&of(id::RESULT_MANAGEMENT), name("ResultManagementType"), "ResultManagementType")
        .subtype_of(ObjectTypeId::BaseObjectType)
        .generates_event(of(id::RESULT_READY_EVENT))
        .insert(space);
    ObjectTypeBuilder::new(&of(id::RESULT_READY_EVENT), name("ResultReadyEventType"), "ResultReadyEventType")
        .is_abstract(true)
        .subtype_of(ObjectTypeId::BaseEventType)
        .insert(space);
    VariableTypeBuilder::new(&of(id::RESULT), name("ResultType"), "ResultType")
        .data_type(of(id::RESULT_DATA))
        .subtype_of(VariableTypeId::BaseDataVariableType)
        .insert(space);
    VariableBuilder::new(&of(id::RESULT_OF_EVENT), name("Result"), "Result")
        .data_type(of(id::RESULT_DATA))
        .has_type_definition(of(id::RESULT))
        .has_modelling_rule(ObjectId::ModellingRule_Mandatory)
        .component_of(of(id::RESULT_READY_EVENT))
        .insert(space);
    add_evaluation(space, ns);
    add_structure(space, ns, (id::RESULT_META_DATA, id::RESULT_META_DATA_BINARY), "ResultMetaDataType", meta_data(ns));
    let data: Vec<Field> = vec![
        // It may have a subtype, which few clients can read; this describes the same bytes in a way that all can.
        ("ResultMetaData", DataTypeId::Structure.into(), false, false),
        ("ResultContent", DataTypeId::BaseDataType.into(), true, false),
    ];
    add_structure(space, ns, (id::RESULT_DATA, id::RESULT_DATA_BINARY), "ResultDataType", data);
}

fn add_evaluation(space: &mut impl NodeInsertTarget, ns: Namespaces) {
    let field = |(value, name): (i64, &&str)| EnumField {
        value,
        display_name: LocalizedText::from(*name),
        description: LocalizedText::null(),
        name: (*name).into(),
    };
    let fields = Some((0..).zip(&EVALUATIONS).map(field).collect());
    let node = ns.of_result(id::RESULT_EVALUATION);
    DataTypeBuilder::new(&node, QualifiedName::new(ns.result, "ResultEvaluationEnum"), "ResultEvaluationEnum")
        .data_type_definition(DataTypeDefinition::Enum(EnumDefinition { fields }))
        .subtype_of(DataTypeId::Enumeration)
        .insert(space);
    let names: Vec<LocalizedText> = EVALUATIONS.iter().map(|&name| name.into()).collect();
    VariableBuilder::new(&ns.of_result(id::RESULT_EVALUATION_STRINGS), "EnumStrings", "EnumStrings")
        .data_type(DataTypeId::LocalizedText)
        .value_rank(1)
        .value(names)
        .has_type_definition(VariableTypeId::PropertyType)
        .property_of(node)
        .insert(space);
}

/// The fields of `ResultMetaDataType`.
fn meta_data(ns: Namespaces) -> Vec<Field> {
    let text = || NodeId::from(DataTypeId::String);
    let boolean = || NodeId::from(DataTypeId::Boolean);
    let optional = |name, data_type| (name, data_type, false, true);
    let optional_list = |name| (name, text(), true, true);
    vec![
        ("ResultId", text(), false, false),
        optional("HasTransferableDataOnFile", boolean()),
        optional("IsPartial", boolean()),
        optional("IsSimulated", boolean()),
        optional("ResultState", DataTypeId::Int32.into()),
        optional("StepId", text()),
        optional("PartId", text()),
        optional("ExternalRecipeId", text()),
        optional("InternalRecipeId", text()),
        optional("ProductId", text()),
        optional("ExternalConfigurationId", text()),
        optional("InternalConfigurationId", text()),
        optional("JobId", text()),
        optional("CreationTime", DataTypeId::DateTime.into()),
        optional("ProcessingTimes", DataTypeId::Structure.into()),
        optional_list("ResultUri"),
        optional("ResultEvaluation", ns.of_result(id::RESULT_EVALUATION)),
        optional("ResultEvaluationCode", DataTypeId::Int64.into()),
        optional("ResultEvaluationDetails", DataTypeId::LocalizedText.into()),
        optional_list("FileFormat"),
    ]
}

fn add_structure(
    space: &mut impl NodeInsertTarget,
    ns: Namespaces,
    (node, encoding): (u32, u32),
    name: &str,
    fields: Vec<Field>,
) {
    let (node, encoding) = (ns.of_result(node), ns.of_result(encoding));
    let structure_type = match fields.iter().any(|&(.., is_optional)| is_optional) {
        true => StructureType::StructureWithOptionalFields,
        false => StructureType::Structure,
    };
    let field = |(name, data_type, is_array, is_optional): Field| StructureField {
        name: name.into(),
        data_type,
        value_rank: if is_array { 1 } else { -1 },
        is_optional,
        ..StructureField::default()
    };
    let definition = StructureDefinition {
        default_encoding_id: encoding.clone(),
        base_data_type: DataTypeId::Structure.into(),
        structure_type,
        fields: Some(fields.into_iter().map(field).collect()),
    };
    DataTypeBuilder::new(&node, QualifiedName::new(ns.result, name), name)
        .data_type_definition(DataTypeDefinition::Structure(definition))
        .subtype_of(DataTypeId::Structure)
        .insert(space);
    ObjectBuilder::new(&encoding, "Default Binary", "Default Binary")
        .reference(ObjectTypeId::DataTypeEncodingType, ReferenceTypeId::HasTypeDefinition, ReferenceDirection::Forward)
        .reference(node, ReferenceTypeId::HasEncoding, ReferenceDirection::Inverse)
        .insert(space);
}

/// Adds the line's own nodes.
pub(super) fn add_line(space: &mut impl NodeInsertTarget, ns: Namespaces, stations: &[u16]) {
    let named = |name: &str| QualifiedName::new(ns.line, name);
    let (line, results) = (ns.of_line("line"), ns.of_line("results"));
    // The event type of the standard is abstract.
    ObjectTypeBuilder::new(&ns.of_line("casing-judged"), named("CasingJudgedEventType"), "CasingJudgedEventType")
        .subtype_of(ns.of_result(id::RESULT_READY_EVENT))
        .insert(space);
    ObjectBuilder::new(&line, named("tapline"), "tapline")
        .has_type_definition(ObjectTypeId::BaseObjectType)
        .organized_by(ObjectId::ObjectsFolder)
        .insert(space);
    ObjectBuilder::new(&management(ns), QualifiedName::new(ns.result, "ResultManagement"), "ResultManagement")
        .event_notifier(EventNotifier::SUBSCRIBE_TO_EVENTS)
        .has_type_definition(ns.of_result(id::RESULT_MANAGEMENT))
        .component_of(line.clone())
        .insert(space);
    ObjectBuilder::new(&results, QualifiedName::new(ns.result, "Results"), "Results")
        .has_type_definition(ObjectTypeId::FolderType)
        .component_of(management(ns))
        .insert(space);
    for &station in stations {
        let object = ns.of_line(&format!("station/{station}"));
        let name = format!("Station{station}");
        ObjectBuilder::new(&object, named(&name), name.as_str())
            .has_type_definition(ObjectTypeId::BaseObjectType)
            .component_of(line.clone())
            .insert(space);
        let types = [
            ("State", DataTypeId::String.into()),
            ("ResultEvaluation", ns.of_result(id::RESULT_EVALUATION)),
            ("JudgedCount", DataTypeId::UInt64.into()),
        ];
        for (of, data_type) in types {
            VariableBuilder::new(&ns.of_station(station, of), named(of), of)
                .data_type(data_type)
                .has_type_definition(VariableTypeId::BaseDataVariableType)
                .component_of(object.clone())
                .insert(space);
        }
        VariableBuilder::new(&ns.of_station(station, "Result"), named(&name), name.as_str())
            .data_type(ns.of_result(id::RESULT_DATA))
            .value(Variant::Empty)
            .has_type_definition(ns.of_result(id::RESULT))
            .component_of(results.clone())
            .insert(space);
    }
}

/// The node that has results and reports them.
pub(super) fn management(ns: Namespaces) -> NodeId {
    ns.of_line("result-management")
}

/// Adds the method `name` to [`management`], with arguments: name, type, and whether it is an array.
pub(super) fn add_method(
    space: &mut impl NodeInsertTarget,
    ns: Namespaces,
    name: &str,
    input: &[(&str, NodeId, bool)],
    output: &[(&str, NodeId, bool)],
) -> NodeId {
    let argument = |(name, data_type, is_array): &(&str, NodeId, bool)| Argument {
        name: (*name).into(),
        data_type: data_type.clone(),
        value_rank: if *is_array { 1 } else { -1 },
        array_dimensions: None,
        description: LocalizedText::null(),
    };
    let node = ns.of_line(&format!("method/{name}"));
    let arguments = |list: &[_]| list.iter().map(argument).collect::<Vec<_>>();
    let [inputs, outputs] = ["in", "out"].map(|end| ns.of_line(&format!("method/{name}/{end}")));
    let mut method = MethodBuilder::new(&node, QualifiedName::new(ns.result, name), name).component_of(management(ns));
    if !input.is_empty() {
        method = method.input_args(space, &inputs, &arguments(input));
    }
    method.output_args(space, &outputs, &arguments(output)).insert(space);
    node
}
