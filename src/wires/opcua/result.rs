//! A verdict as a result in the shape of OPC 40001-101 (Machinery Result Transfer), and the event that one is ready.

use opcua::nodes::{BaseEventType, Event, EventField};
use opcua::types::{
    AttributeId, BinaryDecodable, BinaryEncodable, ByteString, DateTime, ExpandedMessageInfo, ExpandedNodeId,
    ExtensionObject, LocalizedText, NodeId, NumericRange, ObjectTypeId, QualifiedName, UAString, UaNullable, Variant,
};
use tapline_wire::Verdict;

use crate::shown::verdict::CasingVerdict;
use crate::wires::opcua::names::{RESULT_NAMESPACE, id};

/// 100 ns ticks from 1601, where OPC UA begins to count time, to 1970.
const TICKS_TO_1970: i64 = 116_444_736_000_000_000;

/// Severity of an event, up to 1000: most verdicts are news, but a REJECT calls for action.
const SEVERITY: (u16, u16) = (100, 500);

/// The `ResultDataType`.
#[derive(Debug, Clone, Default, PartialEq, BinaryEncodable, BinaryDecodable, UaNullable)]
pub(super) struct ResultData {
    /// A [`ResultMetaData`]; the type may have subtypes.
    pub meta_data: ExtensionObject,
    /// The verdict as JSON.
    pub content: Option<Vec<Variant>>,
}

/// The `ResultMetaDataType`, with those of its optional fields that a verdict has.
#[derive(Debug, Clone, Default, PartialEq, BinaryEncodable, BinaryDecodable, UaNullable)]
pub(super) struct ResultMetaData {
    /// Which optional fields follow: [`FIELDS`].
    fields: u32,
    pub result_id: UAString,
    is_partial: bool,
    /// The casing.
    part_id: UAString,
    creation_time: DateTime,
    /// The archive.
    result_uri: Option<Vec<UAString>>,
    evaluation: i32,
    /// The verdict: 1 PASS, 2 RE-INSPECT, 3 REJECT.
    evaluation_code: i64,
    evaluation_details: LocalizedText,
}

/// Bits of the optional fields that are there: `IsPartial`, `PartId`, `CreationTime`, `ResultUri`, `ResultEvaluation`,
/// `ResultEvaluationCode` and `ResultEvaluationDetails`.
const FIELDS: u32 = 1 << 1 | 1 << 5 | 1 << 12 | 1 << 14 | 1 << 15 | 1 << 16 | 1 << 17;

/// The `ResultEvaluationEnum` of a verdict: `OK`, `NotDecidable` or `NotOK`; 0 is `Undefined`.
pub(super) fn evaluation(verdict: Verdict) -> i32 {
    match verdict {
        Verdict::Pass => 1,
        Verdict::ReInspect => 3,
        Verdict::Reject => 2,
    }
}

impl ResultMetaData {
    fn new(verdict: &CasingVerdict) -> Self {
        Self {
            fields: FIELDS,
            result_id: verdict.id.as_str().into(),
            is_partial: false,
            part_id: verdict.casing.as_str().into(),
            creation_time: time(verdict.at_ns),
            result_uri: Some(vec![format!("file://{}", verdict.file.display()).into()]),
            evaluation: evaluation(verdict.verdict),
            evaluation_code: verdict.verdict.code().into(),
            evaluation_details: LocalizedText::new("en", &verdict.verdict.to_string()),
        }
    }

    /// The field called `name`.
    fn field(&self, name: &str) -> Variant {
        match name {
            "ResultId" => self.result_id.clone().into(),
            "IsPartial" => self.is_partial.into(),
            "PartId" => self.part_id.clone().into(),
            "CreationTime" => self.creation_time.into(),
            "ResultEvaluation" => self.evaluation.into(),
            "ResultEvaluationCode" => self.evaluation_code.into(),
            "ResultEvaluationDetails" => self.evaluation_details.clone().into(),
            _ => Variant::Empty,
        }
    }
}

/// The result of a verdict.
pub(super) fn result(verdict: &CasingVerdict) -> Variant {
    let meta_data = ExtensionObject::from_message(ResultMetaData::new(verdict));
    let content = Some(vec![UAString::from(verdict.json()).into()]);
    ExtensionObject::from_message(ResultData { meta_data, content }).into()
}

fn time(at_ns: i64) -> DateTime {
    DateTime::from(at_ns / 100 + TICKS_TO_1970)
}

impl ExpandedMessageInfo for ResultData {
    fn full_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_DATA_BINARY)
    }
    fn full_json_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_DATA)
    }
    fn full_xml_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_DATA)
    }
    fn full_data_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_DATA)
    }
}

impl ExpandedMessageInfo for ResultMetaData {
    fn full_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_META_DATA_BINARY)
    }
    fn full_json_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_META_DATA)
    }
    fn full_xml_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_META_DATA)
    }
    fn full_data_type_id(&self) -> ExpandedNodeId {
        expanded(id::RESULT_META_DATA)
    }
}

fn expanded(id: u32) -> ExpandedNodeId {
    ExpandedNodeId::from((NodeId::new(0, id), RESULT_NAMESPACE))
}

/// The event that a verdict is ready, a `ResultReadyEventType`.
#[derive(Debug)]
pub(super) struct ResultReady {
    base: BaseEventType,
    /// Index of the namespace of results.
    namespace: u16,
    result: Variant,
    meta_data: ResultMetaData,
}

impl ResultReady {
    /// The event of type `event_type` that `verdict` is ready; `source` is the node that has it.
    pub(super) fn new(verdict: &CasingVerdict, event_type: NodeId, source: &NodeId, namespace: u16) -> Self {
        let severity = if verdict.verdict == Verdict::Reject { SEVERITY.1 } else { SEVERITY.0 };
        let base = BaseEventType {
            event_id: ByteString::from(verdict.id.as_bytes()),
            event_type,
            source_node: source.clone(),
            source_name: format!("station {}", verdict.station).into(),
            time: time(verdict.at_ns),
            receive_time: time(verdict.at_ns),
            message: LocalizedText::new("en", &format!("casing {}: {}", verdict.casing, verdict.verdict)),
            severity,
            ..BaseEventType::default()
        };
        Self { base, namespace, result: result(verdict), meta_data: ResultMetaData::new(verdict) }
    }
}

impl Event for ResultReady {
    fn get_field(&self, _: &NodeId, attribute: AttributeId, range: &NumericRange, path: &[QualifiedName]) -> Variant {
        self.get_value(attribute, range, path)
    }

    fn time(&self) -> &DateTime {
        &self.base.time
    }

    fn event_type_id(&self) -> &NodeId {
        &self.base.event_type
    }
}

impl EventField for ResultReady {
    fn get_value(&self, attribute: AttributeId, range: &NumericRange, path: &[QualifiedName]) -> Variant {
        let names: Vec<&str> = path.iter().map(|part| part.name.as_ref()).collect();
        let is_ours = attribute == AttributeId::Value && path.iter().all(|part| part.namespace_index == self.namespace);
        match names.as_slice() {
            ["Result"] if is_ours => self.result.clone(),
            ["Result", "ResultMetaData"] if is_ours => ExtensionObject::from_message(self.meta_data.clone()).into(),
            ["Result", "ResultMetaData", name] if is_ours => self.meta_data.field(name),
            _ => self.base.get_field(&ObjectTypeId::BaseEventType.into(), attribute, range, path),
        }
    }
}
